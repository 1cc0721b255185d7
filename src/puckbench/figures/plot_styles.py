"""Plot styles of codecs: title, colour and marker, the same in every figure."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from puckbench.codecs.facts import CodecFacts, Line
from puckbench.codecs.registry import codec_class, is_codec


@dataclass(frozen=True)
class PlotStyle:
    """Plot style of a codec: legend title, hexadecimal colour, and matplotlib marker and line."""

    title: str
    colour: str
    marker: str
    line: Line = "-"


_OTHER_COLOURS = ("#44AA99", "#AA4499", "#DDAA33", "#117733", "#BB5566", "#6699CC", "#5D4037")
_OTHER_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "d", "<", ">")
_OTHER_LINES: tuple[Line, ...] = (":", "--", "-.")


def codec_style(codec: str) -> PlotStyle:
    """Return the plot style of a codec from its class; missing parts are derived from its name."""
    facts, derived = _registered(codec), _style_from_name(codec)
    if facts is None:
        return derived
    return PlotStyle(
        title=facts.title or codec,
        colour=facts.colour or derived.colour,
        marker=facts.marker or derived.marker,
        line=facts.line if facts.colour else derived.line,
    )


def codec_rank(codec: str) -> tuple[int, str]:
    """Return the sorting key of a codec in legends: rank of its class, then name."""
    facts = _registered(codec)
    return (CodecFacts.rank if facts is None else facts.rank, codec)


def _registered(codec: str) -> type[CodecFacts] | None:
    return codec_class(codec) if is_codec(codec) else None


def _style_from_name(codec: str) -> PlotStyle:
    digest = hashlib.sha256(codec.encode()).digest()
    return PlotStyle(
        title=codec,
        colour=_OTHER_COLOURS[digest[0] % len(_OTHER_COLOURS)],
        marker=_OTHER_MARKERS[digest[1] % len(_OTHER_MARKERS)],
        line=_OTHER_LINES[digest[2] % len(_OTHER_LINES)],
    )


def dataset_title(dataset: str) -> str:
    """Return the default title of a data set: its name in words."""
    words = dataset.replace("_", " ")
    return words[:1].upper() + words[1:]
