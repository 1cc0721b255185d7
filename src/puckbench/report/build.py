from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.tables import read_table
from pointkit.threads import in_threads
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.report.captions import caption_html
from puckbench.report.contents import Contents, register_user_plugins
from puckbench.report.findings import findings
from puckbench.report.page import whole_page
from puckbench.report.pictures import embedded
from puckbench.report.plot_data import plot_payload
from puckbench.report.run_description import RunDescription, describe_run
from puckbench.report.run_record import RunRecord
from puckbench.report.sections import SectionData, sections_of
from puckbench.report.tables import table_html
from puckbench.report.viewer_data import viewer_payload
from puckbench.results.columns import name_in_words
from puckbench.tables.registry import TABLES, table_entry

if TYPE_CHECKING:
    import pandas as pd
    from markupsafe import Markup

_PARTS = {
    "curves": "Rate and distortion",
    "clouds": "Example clouds",
    "figures": "Figures",
    "tables": "Tables",
    "run": "The run",
}


@dataclass(frozen=True)
class TableShown:
    """A table of the report's page, with title and caption, as HTML."""

    name: str
    title: str
    html: Markup
    caption: Markup


def build_page(
    contents: Contents,
    machine: Mapping[str, str],
    folder: Path,
    record: RunRecord = RunRecord(),  # noqa: B008 (frozen)
    remarks: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Build the HTML page of the report.

    The page depends only on the arguments and on the files that `contents` names. Tables without
    rows are left out.

    Parameters
    ----------
    contents
        Files of tables, figures and clouds, and options of the page.
    machine
        Entries in the page's section on the run, by name.
    folder
        Folder of the page, from which links to files are relative.
    record
        Date, duration and commits of the run.
    remarks
        Further entries in the page's header, by name.

    Returns
    -------
    str
        The page as HTML.

    Raises
    ------
    InputError
        A file is missing or unreadable.
    """
    register_user_plugins(contents.own_figures, contents.own_tables)
    style = FigureStyle.from_config(*contents.style)
    metrics = None if contents.metrics is None else read_table(Path(contents.metrics))
    files = {name: Path(file) for name, file in contents.tables.items()}
    tables = {name: read_table(file) for name, file in files.items() if not _is_empty(file)}
    scan_errors = tables.get("scan_errors")
    data: dict[str, Any] = {}
    sections = sections_of(tables)
    headings = {"findings": "Findings", **{each.name: each.title for each in sections}, **_PARTS}
    shown = {name for section in sections for name in section.tables}
    listed = {name: table for name, table in tables.items() if name not in shown}
    page_parts: dict[str, Any] = {"tables": list(_tables(contents, listed, folder, style))}
    if metrics is not None:
        data["curves"] = plot_payload(metrics, style)
    if metrics is not None or "odometry_bits" in tables:
        page_parts["findings"] = findings(metrics, tables, style)
    if contents.examples:
        data["clouds"] = viewer_payload(contents, metrics, scan_errors, style)
    of_run = SectionData(
        tables=tables,
        links={name: _link(file, folder) for name, file in files.items()},
        figures={name: _figure_title(name) for name in contents.figures},
    )
    page_parts |= {section.name: section.make(of_run) for section in sections}
    page_parts["figures"] = _by_category(contents, folder)
    page_parts["run"] = _facts(contents, metrics, tables.get("clouds"), machine, style)
    available = {**data, **page_parts}
    return whole_page(
        title=contents.title,
        record={**record.facts(), **remarks},
        parts={name: heading for name, heading in headings.items() if available.get(name)},
        data=data,
        shown=page_parts,
    )


def _is_empty(file: Path) -> bool:
    """Return whether a CSV file has a heading but no rows."""
    if file.suffix != ".csv" or not file.is_file():
        return False
    with file.open(encoding="utf-8", errors="replace") as lines:
        return len(list(islice(lines, 2))) == 1


def _facts(contents: Contents, *more: Any) -> RunDescription:
    try:
        return describe_run(contents.configuration, *more)
    except (AttributeError, KeyError, TypeError) as error:
        raise InputError(
            "contents of the report: configuration: not the configuration of a run"
        ) from error


def _tables(
    contents: Contents, tables: Mapping[str, pd.DataFrame], folder: Path, style: FigureStyle
) -> Iterator[TableShown]:
    for name, table in tables.items():
        rows_html = table_html(table, _link(Path(contents.tables[name]), folder), style)
        entry = table_entry(name) if name in TABLES else None
        caption = caption_html(entry.caption if entry else "", name)
        yield TableShown(name, entry.title if entry else name_in_words(name), rows_html, caption)


def _by_category(contents: Contents, folder: Path) -> dict[str, list[dict[str, Any]]]:
    categories: dict[str, list[dict[str, Any]]] = {}
    by_number = sorted(contents.figures, key=lambda name: figure_entry(name).sort_key)
    files = [Path(contents.figures[name]) for name in by_number]
    pictures = in_threads(lambda file: embedded(read_bytes(file), str(file)), files)
    for name, file, picture in zip(by_number, files, pictures, strict=True):
        entry = figure_entry(name)
        links = {kind: file.with_suffix(f".{kind.lower()}") for kind in ("PDF", "SVG")}
        figure = {
            "name": name,
            "title": _figure_title(name),
            "picture": picture,
            "caption": caption_html(entry.caption, name),
            "links": {kind: _link(target, folder) for kind, target in links.items()},
        }
        categories.setdefault(entry.category, []).append(figure)
    return categories


def _figure_title(name: str) -> str:
    entry = figure_entry(name)
    return f"{entry.number} {entry.title or name_in_words(name)}".strip()


def _link(file: Path, folder: Path) -> str:
    return file.relative_to(folder).as_posix() if file.is_relative_to(folder) else file.name
