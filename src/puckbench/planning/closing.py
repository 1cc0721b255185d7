"""What a run says at its end: a small table of its results, and where everything lies."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from puckbench.figures.style import FigureStyle

Row = dict[str, str]

_HEADS = {
    "dataset": "data set",
    "codec": "codec",
    "clouds": "clouds",
    "bpp": "bits per point",
    "d1_rms_m": "D1 error, m",
    "d1_psnr": "D1 PSNR, dB",
    "bd_rate_percent": "BD-rate",
    "seconds": "s, at most",
}
REPORT = "report.html"
_PLACES = {"report": REPORT, "tables": "tables", "figures": "figures"}


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
    rows = [_cells(row) for row in summary_rows(results, style, anchor)]
    known = [name for name in _HEADS if any(row[name] for row in rows)]
    heads = [_HEADS[name] for name in known]
    yield from _aligned([heads, *([row[name] for name in known] for row in rows)])
    against = style.of_codec(anchor).title
    yield f"Medians over clouds, lowest to highest rate; BD-rate in D1 against {against}."
    for what, name in _PLACES.items():
        if (results / name).exists():
            yield f"{what + ':':9}{results / name}"


def summary_rows(results: Path, style: FigureStyle, anchor: str) -> list[dict[str, Any]]:
    """A row for each data set and codec: titles, ranges of medians, BD-rate, most seconds."""
    medians = _rows(results / "tables" / "summary.csv")
    deltas = {
        (row["dataset"], row["codec"]): float(row["bd_rate_percent"])
        for row in _rows(results / "tables" / "bd_rate.csv")
        if row["metric"] == "d1_psnr" and row["bd_rate_percent"]
    }
    return [
        _row([row for row in medians if (row["dataset"], row["codec"]) == key], style)
        | {"bd_rate_percent": None if key[1] == anchor else deltas.get(key)}
        for key in dict.fromkeys((row["dataset"], row["codec"]) for row in medians)
    ]


def _row(medians: Sequence[Row], style: FigureStyle) -> dict[str, Any]:
    """What the medians of one codec on one data set say, but its BD-rate."""
    first = medians[0]
    ranges = {name: _range(medians, name) for name in ("bpp", "d1_rms_m", "d1_psnr")}
    return {
        "dataset": style.title(first["dataset"]),
        "codec": style.of_codec(first["codec"]).title,
        "clouds": int(first["clouds"]),
        **ranges,
        "seconds": max(float(row["encode_s"]) + float(row["decode_s"]) for row in medians),
    }


def _range(rows: Sequence[Row], column: str) -> list[float] | None:
    """Least and greatest value of a column; None where it has none."""
    found = [float(row[column]) for row in rows if row.get(column)]
    return [min(found), max(found)] if found else None


def _cells(row: Mapping[str, Any]) -> dict[str, str]:
    """The row in words for a terminal."""
    forms = {"bpp": "{:.2g}", "d1_rms_m": "{:.2g}", "d1_psnr": "{:.0f}"}
    ranges = {
        name: " to ".join(form.format(end) for end in row[name] or ())
        for name, form in forms.items()
    }
    delta = row["bd_rate_percent"]
    return {
        "dataset": row["dataset"],
        "codec": row["codec"],
        "clouds": str(row["clouds"]),
        **ranges,
        "bd_rate_percent": "" if delta is None else f"{delta:+.0f} %",
        "seconds": f"{row['seconds']:.2g}",
    }


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
