from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError, naming
from pointkit.registry import is_place
from puckbench.cli import answers
from puckbench.cli.types import files_by_name, json_object, made_of_tables
from puckbench.figures.plot_styles import read_looks
from puckbench.steps.table import Table
from puckbench.tables.cells import cell_text, interval_text
from puckbench.tables.files import TABLES_FOLDER, read_result, result_file, write_result
from puckbench.tables.latex import interval_ends, latex_table, paper_columns
from puckbench.tables.registry import TABLES, table_entry

if TYPE_CHECKING:
    import pandas as pd

_SUFFIXES = (".csv", ".parquet", ".tex")
_RESULTS = Path("results")


def arguments(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(TABLES.names())
    add = parser.add_argument
    add("table", help=f"one of {names}, or path/to/file.py:function")
    text = (
        "files to write (.csv, .parquet, .tex; otherwise the table is printed) and, without "
        "--inputs, the results folder of a run (default: results)"
    )
    add("places", type=Path, nargs="*", metavar="PLACE", help=text)
    text = "columns joined by commas, at most 8; a column's interval comes with it"
    add("--columns", type=_names, default=(), help=text)
    add("--tex", action="store_true", help="print LaTeX")
    add("--inputs", type=json_object, default={}, help='JSON: {"residuals": "residuals.parquet"}')
    text = 'JSON: {"anchor": "draco"} for bd_rate; the table is then made again'
    add("--options", type=json_object, default={}, help=text)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))


def run(options: argparse.Namespace) -> dict[str, Any] | str:
    files = [path for path in options.places if path.suffix in _SUFFIXES]
    folder = _folder([path for path in options.places if path not in files], bool(options.inputs))
    if files and options.tex:
        raise InputError("--tex: prints the table; the suffixes of files choose their formats")
    with made_of_tables(f"table {options.table}"):
        table = _table(options, folder)
    shown = {"wanted": options.columns, "usual": _usual(options.table)}
    with naming("--columns"):
        columns = paper_columns(table, **shown)
    titles = read_looks(folder / TABLES_FOLDER).get("codec_titles") if folder else None
    answer: dict[str, Any] = {"table": options.table, "rows": len(table)}
    if files:
        write_result(table, None, *files, titles=titles, **shown)
        return {**answer, "files": [str(path) for path in files]}
    text = latex_table(table, columns, titles) if options.tex else _text(table, columns)
    return {**answer, "text": text} if options.json else text.rstrip()


def _folder(places: Sequence[Path], has_inputs: bool) -> Path | None:
    """Return the results folder from which the table is taken, or None if its inputs are given."""
    if not places:
        is_there = (_RESULTS / TABLES_FOLDER).is_dir()
        return _RESULTS if is_there and not has_inputs else None
    if has_inputs or len(places) > 1:
        raise InputError(f"{places[-1]}: not a file to write ({', '.join(_SUFFIXES)})")
    if not (places[0] / TABLES_FOLDER).is_dir():
        raise InputError(
            f"{places[0]}: neither results of a run nor a file ({', '.join(_SUFFIXES)})"
        )
    return places[0]


def _table(options: argparse.Namespace, folder: Path | None) -> pd.DataFrame:
    """Return the table of a run, or made from a run's tables or from the inputs that are given."""
    name, changes = options.table, options.options
    if folder is not None and not is_place(name) and not changes and _is_made(name, folder):
        return read_result(folder, name)
    step = Table.create(table=name, options=changes)
    if folder is None:
        return step.made(files_by_name(options.inputs, "--inputs"))
    entry = table_entry(name)
    inputs = {each: result_file(folder, each) for each in (*entry.inputs, *entry.optional)}
    return step.made({each: path for each, path in inputs.items() if path.exists()})


def _is_made(table: str, folder: Path) -> bool:
    """Return whether a table must be one of the run's, since it cannot be made from others."""
    can_make = table in TABLES and not table_entry(table).gathered
    return result_file(folder, table).exists() or not can_make


def _usual(table: str) -> tuple[str, ...]:
    return table_entry(table).shown if table in TABLES else ()


def _text(table: pd.DataFrame, columns: Sequence[str]) -> str:
    names = [str(name) for name in table]
    ends = {name: interval_ends(name, names) for name in columns}
    rows = [[_cell(row, name, ends[name]) for name in columns] for row in table.to_dict("records")]
    return "\n".join(answers.table([columns, *rows]))


def _cell(row: Mapping[Any, Any], name: str, ends: tuple[str, str] | None) -> str:
    if ends is None or not all(cell_text(row[each]) for each in (name, *ends)):
        return cell_text(row[name])
    return interval_text(row[name], row[ends[0]], row[ends[1]])
