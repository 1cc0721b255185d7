from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from puckbench.codecs.registry import Entry, Line, Look, is_codec, look


@dataclass(frozen=True)
class PlotStyle:
    """How figures draw a codec or a data set.

    Parameters
    ----------
    title
        Title in legends.
    colour, marker, line
        Colour, marker and line style, as values of matplotlib.
    """

    title: str
    colour: str
    marker: str
    line: Line = "-"


_OTHER_COLOURS = ("#44AA99", "#AA4499", "#DDAA33", "#117733", "#BB5566", "#6699CC", "#5D4037")
_OTHER_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "d", "<", ">")
_OTHER_LINES: tuple[Line, ...] = (":", "--", "-.")


DATASET_COLOURS = (
    *("#2255CC", "#CCBB22", "#442255", "#AA8899"),
    *("#666600", "#AAAAFF", "#222200", "#DDBB88"),
)
OTHER_MODEL_COLOURS = ("#885577", "#557799", "#998877", "#336644")
"""Colours of error models that do not come with puckbench, chosen by the model's name."""


def codec_style(codec: str) -> PlotStyle:
    """Return the style of a codec by its name; an unregistered name gets a derived style."""
    return entry_style(codec) if is_codec(codec) else _style_from_name(codec)


def entry_style(name: str, entry: Entry | None = None) -> PlotStyle:
    """Return the style of a codec with its entry in a configuration, as in `registry.look`.

    Missing parts of the style are derived from the name.
    """
    derived, given = _style_from_name(name), look(name, entry)
    return PlotStyle(
        title=given.title or name,
        colour=given.colour or derived.colour,
        marker=given.marker or derived.marker,
        line=given.line if given.colour else derived.line,
    )


def read_looks(folder: Path) -> dict[str, dict[str, str]]:
    """Read the styles of codecs from the table ``codecs`` in a folder.

    Returns
    -------
    dict
        Options for `FigureStyle`, as from `looks_layer`; empty if the folder has no such table.
    """
    from pointkit.tables import read_table

    path = folder / "codecs.parquet"
    if not path.exists():
        return {}
    table = read_table(path).astype(str)
    return looks_layer({str(k): str(v) for k, v in row.items()} for row in table.to_dict("records"))


def looks_layer(rows: Iterable[Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """Convert rows of the table ``codecs`` to options for `FigureStyle`.

    Returns
    -------
    dict
        Values by name of the codec, for the options ``codec_titles``, ``colours``, ``markers`` and
        ``lines``; empty without rows.
    """
    keys = {"title": "codec_titles", "colour": "colours", "marker": "markers", "line": "lines"}
    rows = list(rows)
    layer = {option: {row["codec"]: row[key] for row in rows} for key, option in keys.items()}
    return layer if rows else {}


def codec_rank(codec: str) -> tuple[int, str]:
    """Return a key by which codecs are sorted in legends."""
    return (look(codec).rank if is_codec(codec) else Look().rank, codec)


def _style_from_name(codec: str) -> PlotStyle:
    digest = hashlib.sha256(codec.encode()).digest()
    return PlotStyle(
        title=codec,
        colour=_OTHER_COLOURS[digest[0] % len(_OTHER_COLOURS)],
        marker=_OTHER_MARKERS[digest[1] % len(_OTHER_MARKERS)],
        line=_OTHER_LINES[digest[2] % len(_OTHER_LINES)],
    )


def error_model_colour(model: str) -> str:
    """Return the colour of an error model by its name, the same in every figure and process."""
    from virtual_lidar.errors import error_model_style

    own = error_model_style(model).colour
    digest = hashlib.sha256(model.encode()).digest()
    return own or OTHER_MODEL_COLOURS[digest[0] % len(OTHER_MODEL_COLOURS)]


def dataset_style(place: int, title: str) -> PlotStyle:
    """Return the style of a data set, given its place in the order of data sets and its title."""
    return PlotStyle(
        title,
        DATASET_COLOURS[place % len(DATASET_COLOURS)],
        _OTHER_MARKERS[place % len(_OTHER_MARKERS)],
    )


def dataset_title(dataset: str) -> str:
    """Return the name of a data set as words: "Noisy rooms" for "noisy_rooms"."""
    words = dataset.replace("_", " ")
    return words[:1].upper() + words[1:]
