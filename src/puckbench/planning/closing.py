"""What a run says at its end: a small table of its results, and where everything lies."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from puckbench.figures.style import FigureStyle

Row = dict[str, str]

_HEADS = ("data set", "codec", "clouds", "bits per point", "D1 PSNR, dB", "BD-rate", "s, at most")
_PLACES = {"report": "report.html", "tables": "tables", "figures": "figures"}


def closing_lines(results: Path, style: FigureStyle, anchor: str, since: float) -> Iterator[str]:
    """The lines; none where the run made no table of medians.

    Parameters
    ----------
    style
        Titles of data sets and codecs.
    anchor
        The codec that BD-rates are against.
    since
        Time stamp of the run's beginning.
    """
    summary = results / "tables" / "summary.csv"
    if not summary.exists() or summary.stat().st_mtime < since:
        return
    medians = _rows(summary)
    deltas = {
        (row["dataset"], row["codec"]): row["bd_rate_percent"]
        for row in _rows(results / "tables" / "bd_rate.csv")
        if row["metric"] == "d1_psnr" and row["bd_rate_percent"]
    }
    yield from _aligned([_HEADS, *_cells(medians, deltas, style)])
    against = style.of_codec(anchor).title
    yield f"Medians over clouds, lowest to highest rate; BD-rate in D1 against {against}."
    for what, name in _PLACES.items():
        if (results / name).exists():
            yield f"{what + ':':9}{results / name}"


def _cells(
    medians: Sequence[Row], deltas: Mapping[tuple[str, str], str], style: FigureStyle
) -> Iterator[tuple[str, ...]]:
    """One row of the table for each data set and codec."""
    for key in dict.fromkeys((row["dataset"], row["codec"]) for row in medians):
        rows = [row for row in medians if (row["dataset"], row["codec"]) == key]
        slowest = max(float(row["encode_s"]) + float(row["decode_s"]) for row in rows)
        delta = f"{float(deltas[key]):+.0f} %" if key in deltas else ""
        yield (
            style.title(key[0]),
            style.of_codec(key[1]).title,
            rows[0]["clouds"],
            _range(rows, "bpp", "{:.2g}"),
            _range(rows, "d1_psnr", "{:.0f}"),
            delta,
            f"{slowest:.2g}",
        )


def _range(rows: Sequence[Row], column: str, form: str) -> str:
    found = [float(row[column]) for row in rows if row.get(column)]
    return f"{form.format(min(found))} to {form.format(max(found))}" if found else ""


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Columns of equal width: words to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = zip(row, widths, strict=True)
        yield "  ".join(
            f"{cell:{'<' if place < 2 else '>'}{width}}"
            for place, (cell, width) in enumerate(cells)
        ).rstrip()


def _rows(path: Path) -> list[Row]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
