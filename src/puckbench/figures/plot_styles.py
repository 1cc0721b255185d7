"""How each codec is shown: one title, colour and marker wherever it appears."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from puckbench.codecs.facts import CodecFacts, Line
from puckbench.codecs.registry import codec_class, is_codec


@dataclass(frozen=True)
class PlotStyle:
    """How a codec is drawn.

    Parameters
    ----------
    title
        In the legend.
    colour
        Hexadecimal.
    marker, line
        Of matplotlib.
    """

    title: str
    colour: str
    marker: str
    line: Line = "-"


_OTHER_COLOURS = ("#44AA99", "#AA4499", "#DDAA33", "#117733", "#BB5566", "#6699CC", "#5D4037")
_OTHER_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "d", "<", ">")
_OTHER_LINES: tuple[Line, ...] = (":", "--", "-.")


def codec_style(codec: str) -> PlotStyle:
    """The plot style of a codec: what its class says, the rest derived from its name.

    So a codec looks the same in every figure, whichever others are drawn beside it.
    """
    known, other = _registered(codec), _of_name(codec)
    if known is None:
        return other
    return PlotStyle(
        title=known.title or codec,
        colour=known.colour or other.colour,
        marker=known.marker or other.marker,
        line=known.line if known.colour else other.line,
    )


def codec_rank(codec: str) -> tuple[int, str]:
    """Sorting key of codecs in legends: by the ranks of their classes, then by name."""
    known = _registered(codec)
    return (CodecFacts.rank if known is None else known.rank, codec)


def _registered(codec: str) -> type[CodecFacts] | None:
    return codec_class(codec) if is_codec(codec) else None


def _of_name(codec: str) -> PlotStyle:
    digest = hashlib.sha256(codec.encode()).digest()
    return PlotStyle(
        title=codec,
        colour=_OTHER_COLOURS[digest[0] % len(_OTHER_COLOURS)],
        marker=_OTHER_MARKERS[digest[1] % len(_OTHER_MARKERS)],
        line=_OTHER_LINES[digest[2] % len(_OTHER_LINES)],
    )


def dataset_title(dataset: str) -> str:
    """Title of a data set to which the configuration gives none: its name in words."""
    words = dataset.replace("_", " ")
    return words[:1].upper() + words[1:]
