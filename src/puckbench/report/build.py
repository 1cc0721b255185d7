"""From a run's files to the page's text: what both the command line and the workflow call."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.core.files import read_bytes
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.io.tables import read_table
from puckbench.metrics.registry import TABLES, table_entry
from puckbench.report.captions import caption_html
from puckbench.report.clouds import viewer_payload
from puckbench.report.contents import Contents
from puckbench.report.curves import curves
from puckbench.report.facts import run_facts
from puckbench.report.page import whole_page
from puckbench.report.pictures import Picture, embedded
from puckbench.report.tables import table_html

if TYPE_CHECKING:
    import pandas as pd
    from markupsafe import Markup

_FIRST = "Claims"
"""The category of tables that stands first."""
_PARTS = {
    "run": "The run",
    "curves": "Rate and distortion",
    "clouds": "Example clouds",
    "tables": "Tables",
    "figures": "Figures",
}
_CHAPTERS = {
    "5": "Chapter 5: the sensor and its errors",
    "6": "Chapter 6: what compression does",
    "": "Beyond the thesis",
}


@dataclass(frozen=True)
class FigureShown:
    """A figure with its caption; `link` leads to the file to print from."""

    name: str
    title: str
    picture: Picture
    caption: Markup
    link: str


@dataclass(frozen=True)
class TableShown:
    """A table as HTML, with its caption."""

    name: str
    title: str
    html: Markup
    caption: Markup


def build_page(contents: Contents, machine: Mapping[str, str], folder: Path) -> str:
    """The page as text; the same files and the same machine give the same text.

    Parameters
    ----------
    contents
        The files to show.
    machine
        Facts of the machine, by name.
    folder
        Where the page will lie, which its links start from.

    Raises
    ------
    InputError
        A file is missing or cannot be read.
    """
    style = FigureStyle.from_config(*contents.style)
    metrics = None if contents.metrics is None else read_table(Path(contents.metrics))
    tables = {name: read_table(Path(contents.tables[name])) for name in _ordered(contents.tables)}
    data: dict[str, Any] = {}
    if metrics is not None:
        data["curves"] = curves(metrics, style)
    if contents.examples:
        data["clouds"] = viewer_payload(contents, metrics, style)
    there = {"run": True, **data, "tables": tables, "figures": contents.figures}
    return whole_page(
        title=contents.title,
        parts={name: heading for name, heading in _PARTS.items() if there.get(name)},
        run=run_facts(contents.configuration, metrics, tables.get("clouds"), machine, style),
        data=data,
        tables=list(_tables(contents, tables, folder)),
        figures=_chapters(contents, folder),
    )


def _ordered(tables: Mapping[str, str]) -> list[str]:
    """Names of tables, those of the category `_FIRST` before the others."""
    first = [n for n in tables if n in TABLES and table_entry(n).category == _FIRST]
    return first + [name for name in tables if name not in first]


def _tables(
    contents: Contents, tables: Mapping[str, pd.DataFrame], folder: Path
) -> Iterator[TableShown]:
    for name, table in tables.items():
        html = table_html(table, _link(Path(contents.tables[name]), folder))
        entry = table_entry(name) if name in TABLES else None
        caption = caption_html(entry.caption if entry else "", name)
        yield TableShown(name, entry.title if entry else name, html, caption)


def _chapters(contents: Contents, folder: Path) -> dict[str, list[FigureShown]]:
    """The figures by chapter of the thesis, then those that it does not have."""
    chapters: dict[str, list[FigureShown]] = {heading: [] for heading in _CHAPTERS.values()}
    for name, file in contents.figures.items():
        heading = _CHAPTERS.get(figure_entry(name).thesis[:1], _CHAPTERS[""])
        chapters[heading].append(_figure(name, Path(file), folder))
    return {heading: shown for heading, shown in chapters.items() if shown}


def _figure(name: str, file: Path, folder: Path) -> FigureShown:
    entry = figure_entry(name)
    return FigureShown(
        name,
        f"{entry.thesis} {entry.title or name}".strip(),
        embedded(read_bytes(file), str(file)),
        caption_html(entry.caption, name),
        _link(file.with_suffix(".pdf"), folder),
    )


def _link(file: Path, folder: Path) -> str:
    """The way from the page's folder to a file below it; the bare name of any other."""
    return file.relative_to(folder).as_posix() if file.is_relative_to(folder) else file.name
