from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from puckbench.codecs.facts import CodecFacts, Line
from puckbench.codecs.registry import codec_class, is_codec


@dataclass(frozen=True)
class PlotStyle:
    title: str
    colour: str
    marker: str
    line: Line = "-"


_OTHER_COLOURS = ("#44AA99", "#AA4499", "#DDAA33", "#117733", "#BB5566", "#6699CC", "#5D4037")
_OTHER_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "d", "<", ">")
_OTHER_LINES: tuple[Line, ...] = (":", "--", "-.")


def codec_style(codec: str) -> PlotStyle:
    return class_style(codec, _registered(codec))


def class_style(name: str, codec: type[CodecFacts] | None) -> PlotStyle:
    derived = _style_from_name(name)
    if codec is None:
        return derived
    return PlotStyle(
        title=codec.title or name,
        colour=codec.colour or derived.colour,
        marker=codec.marker or derived.marker,
        line=codec.line if codec.colour else derived.line,
    )


def read_looks(folder: Path) -> dict[str, dict[str, str]]:
    """Return plot styles from a folder's table ``codecs``, if it exists (see `looks_layer`)."""
    from puckbench.io.tables import read_table

    path = folder / "codecs.parquet"
    if not path.exists():
        return {}
    table = read_table(path).astype(str)
    return looks_layer({str(k): str(v) for k, v in row.items()} for row in table.to_dict("records"))


def looks_layer(rows: Iterable[Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """Return options for `FigureStyle` from rows of the table ``codecs``."""
    keys = {"title": "codec_titles", "colour": "colours", "marker": "markers", "line": "lines"}
    rows = list(rows)
    layer = {option: {row["codec"]: row[key] for row in rows} for key, option in keys.items()}
    return layer if rows else {}


def codec_rank(codec: str) -> tuple[int, str]:
    """Return a codec's sorting key for legends."""
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
    words = dataset.replace("_", " ")
    return words[:1].upper() + words[1:]
