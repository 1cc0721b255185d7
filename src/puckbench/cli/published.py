"""The part of `puckbench compare` that puts a run beside published numbers (``--published``)."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError, naming

if TYPE_CHECKING:
    import pandas as pd

_NAME = "published"


def published_answer(
    options: argparse.Namespace, metrics: pd.DataFrame, clouds: pd.DataFrame, looks: Any
) -> dict[str, Any]:
    """Put a run beside published numbers, write figure and tables, and return what was found."""
    from pointkit.tables import write_table
    from puckbench.figures.drawing import lay_out, save_figure
    from puckbench.figures.published import draw_published
    from puckbench.figures.style import FigureStyle
    from puckbench.published_sources.beside import (
        beside_published,
        bits_at_equal_quality,
        marks_of,
    )
    from puckbench.published_sources.curve_rows import tables_of_curves
    from puckbench.published_sources.registry import all_sources, source_named

    sources = [source_named(name) for name in options.sources] or all_sources()
    datasets = _datasets(options)
    chosen = metrics[metrics["codec"].isin(options.codecs)] if options.codecs else metrics
    with naming(options.results):
        if chosen.empty:
            raise InputError(f"no results of {', '.join(options.codecs)}")
        points = beside_published(chosen, clouds, datasets, sources, options.metrics)
    deltas = bits_at_equal_quality(points)
    folder = options.results if options.results.is_dir() else Path()
    place = (options.out or folder / "comparison") / _NAME
    figures = [place.with_suffix(suffix) for suffix in (".png", ".pdf", ".svg")]
    style = FigureStyle.from_config(looks)
    with style.context():
        lay_out(figure := draw_published(points, style))
        for path in figures:
            save_figure(figure, path)
    tables = {place.with_suffix(".csv"): points, place.with_name(f"{_NAME}_bd_rate.csv"): deltas}
    for path, table in tables.items():
        write_table(table, path)
    used = set(points["origin"])
    return {
        "datasets": datasets,
        "sources": {
            each.title: {"address": each.address, "licence": each.licence, "remark": each.remark}
            for each in sources
            if each.title in used
        },
        "curves": tables_of_curves(points),
        "differences": {mark: text for text, mark in marks_of(points).items()},
        "deltas": [
            {name: None if _is_missing(value) else value for name, value in row.items()}
            for row in deltas.to_dict("records")
        ],
        "files": [str(path) for path in (*figures, *tables)],
    }


def _is_missing(value: object) -> bool:
    return isinstance(value, float) and isnan(value)


def _datasets(options: argparse.Namespace) -> dict[str, str]:
    """Return the published name of each data set: from ``--as``, or else from the run's own table.

    The run has the table if its configuration names published data sets.
    """
    from pointkit.tables import read_table
    from puckbench.tables.files import result_file

    if options.known_as:
        pairs = [text.partition("=") for text in options.known_as]
        if wrong := ["".join(pair) for pair in pairs if not all(pair)]:
            raise InputError(f"--as {wrong[0]}: not DATASET=NAME, such as turns=KITTI")
        return {dataset: name for dataset, _, name in pairs}
    path = result_file(options.results, _NAME)
    if not path.exists():
        raise InputError("--published needs --as DATASET=NAME, such as turns=KITTI")
    rows = read_table(path)[["dataset", "published_as"]].drop_duplicates()
    return dict(rows.itertuples(index=False))


# ---- for a terminal


def published_text(answer: Mapping[str, Any]) -> str:
    """Format the answer of `published_answer` as text for a terminal."""
    from puckbench.planning.run_summary import aligned
    from puckbench.published_sources.curve_rows import HEADS

    lines: list[str] = []
    for title, rows in answer["curves"].items():
        lines += [title, *aligned([HEADS, *rows], left=len(HEADS)), ""]
    pairs = list(_pairs(answer["deltas"], answer["differences"]))
    if pairs:
        lines += ["bits at equal quality, of this run against published curves"]
        lines += [*aligned(pairs, left=3), ""]
    return "\n".join([*lines, *_closing(answer)])


def _pairs(deltas: Sequence[Mapping[str, Any]], marks: Mapping[str, str]) -> Iterator[list[str]]:
    mark_of = {text: mark for mark, text in marks.items()}
    for row in deltas:
        anchor = f"{row['anchor']}, {row['anchor_version']}, {row['origin']}, {row['cloud']}"
        percent = row["bd_rate_percent"]
        value = f"none: {row['bd_rate_status']}" if percent is None else f"{percent:+.1f} %"
        mark = mark_of.get(row["differs"], "")
        metric = f"{row['dataset']}, {row['metric']}"
        yield [metric, f"{row['codec']} against {anchor}", mark, value.replace("-", "−")]


def _closing(answer: Mapping[str, Any]) -> Iterator[str]:
    if answer["differences"]:
        yield "Conditions of published curves that differ from this run's:"
    for mark, text in answer["differences"].items():
        yield f"{mark} {text}"
    yield "Published clouds are known by name only: whether the points are the same is not known."
    for title, source in answer["sources"].items():
        remark = f" {source['remark']}" if source["remark"] else ""
        yield f"{title}: {source['address']} ({source['licence']}).{remark}"
    yield f"files: {', '.join(answer['files'])}"
