from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from puckbench.figures.style import FigureStyle
from puckbench.recordings.drives import AZIMUTH, NONE
from puckbench.report.bd_rate_text import delta_text, has_delta
from puckbench.results.columns import TASK, column_named, is_declared
from puckbench.results.curves import REMARK
from puckbench.tables.registry import UNDECODED

Row = dict[str, str]


def _ends(form: str) -> Callable[[list[float] | None], str]:
    return lambda ends: " to ".join(f"{end:{form}}" for end in ends or ())


_RANGES = ("bpp", "d1_rms_m", "d1_psnr")
"""Columns of the table ``summary`` whose least and greatest medians are printed."""
_COLUMNS: dict[str, tuple[str, Callable[[Any], str]]] = {
    **{name: (column_named(name).heading, str) for name in ("dataset", "codec", "clouds")},
    **{each.name: (each.heading, _ends(each.digits)) for each in map(column_named, _RANGES)},
    "bd_rate": ("BD-rate", str),
    "seconds": ("s, at most", "{:.2g}".format),
}
"""Heading and format of each printed column, by key of a row in `summary_rows`."""
_RATE_COLUMNS = (
    *("bpp", "file_ratio", "d1_rms_mm", "d2_rms_mm", "range_rms_mm", "q99_mm", "largest_mm"),
    *("encode_s", "decode_s"),
)
"""Columns of the table ``rates`` that are printed."""
_MAX_RATES = 24
_MAX_REMARKS = 10
_MAX_TASKS = 5
_TIMES = {AZIMUTH: ", azimuth times", NONE: ", no times"}
"""Text after the rate of a drive whose codec does not keep the times at which lasers fired."""
REPORT = "report.html"
_PLACES = {"report": REPORT, "tables": "tables", "figures": "figures"}


def closing_lines(
    results: Path, style: FigureStyle, anchor: str, since: float, tables: Collection[str]
) -> Iterator[str]:
    """Yield the lines that a run prints at its end: results, and where the files are.

    There are none if the run made none of the tables that are summarised.

    Parameters
    ----------
    results
        The results folder.
    style
        Style with the titles of data sets and codecs.
    anchor
        Name of the codec against which BD-rates compare.
    since
        Time stamp of the run's start, in s; older tables are not summarised.
    tables
        Names of the tables of this run.
    """
    files = {name: results / "tables" / f"{name}.csv" for name in _LINES if name in tables}
    made = [n for n, file in files.items() if file.exists() and file.stat().st_mtime >= since]
    for name in made:
        yield from _LINES[name](results, style, anchor)
    for what, name in _PLACES.items() if made else ():
        if (results / name).exists():
            yield f"{what + ':':9}{results / name}"


def _median_lines(results: Path, style: FigureStyle, anchor: str) -> Iterator[str]:
    shown = summary_rows(results, style, anchor)
    texts = {name: [form(row[name]) for row in shown] for name, (_, form) in _COLUMNS.items()}
    texts = {name: column for name, column in texts.items() if any(column)}
    yield from aligned([[_COLUMNS[name][0] for name in texts], *zip(*texts.values(), strict=True)])
    against = f"; BD-rate in D1 against {style.of_codec(anchor).title}"
    if "bd_rate" not in texts:
        against = ""
    yield f"Medians over clouds, lowest to highest rate{against}."
    yield from _remarks(shown)
    yield from _rate_lines(results, style)
    yield from _odd_results(results)


def _drive_lines(results: Path, style: FigureStyle, anchor: str) -> Iterator[str]:
    path = results / "tables" / "drives.csv"
    groups: dict[tuple[str, ...], list[Row]] = {}
    rows = _rows(path)
    for row in rows:
        key = (row["dataset"], row["codec"], row["rate"], row.get("times", ""))
        groups.setdefault(key, []).append(row)
    if len(groups) > _MAX_RATES:
        yield f"Tasks on drives at each rate: {path}"
        return
    columns = _task_columns(rows)
    heads = ["data set", "codec and rate", "drives", "bits per point", *columns]
    yield from aligned([heads, *(_drive_cells(group, columns, style) for group in groups.values())])
    yield f"Means over drives; more columns: {path}"


def _task_columns(rows: Sequence[Row]) -> list[str]:
    """Return the names of the most important columns with results of tasks, without settings."""
    # A setting starts with the name of another column, and has the same value in all rows.
    names = [
        name
        for name in rows[0]
        if (not is_declared(name) or column_named(name).group == TASK)
        and all(_is_number(row[name]) for row in rows)
        and (name.partition("_")[0] not in rows[0] or len({row[name] for row in rows}) > 1)
    ]
    return sorted(names, key=lambda name: not column_named(name).summarised)[:_MAX_TASKS]


def _is_number(text: str) -> bool:
    try:
        float(text or 0)
    except ValueError:
        return False
    return True


def _drive_cells(rows: Sequence[Row], columns: Sequence[str], style: FigureStyle) -> list[str]:
    first = rows[0]
    values = {name: [float(row[name]) for row in rows if row[name]] for name in ("bpp", *columns)}
    times = "" if first["codec"] == UNDECODED else _TIMES.get(first.get("times", ""), "")
    return [
        style.title(first["dataset"]),
        f"{style.of_codec(first['codec']).title} {first['rate']}{times}",
        str(len(rows)),
        *(f"{fmean(numbers):.3g}" if numbers else "" for numbers in values.values()),
    ]


def _odometry_lines(results: Path, style: FigureStyle, anchor: str) -> Iterator[str]:
    path = results / "tables" / "odometry_bits.csv"
    rows = _rows(path)
    if len(rows) > _MAX_RATES:
        yield f"Bits that odometry needs: {path}"
        return
    yield ""
    heads = ["data set", "odometry and codec", "from rate", "bits per point"]
    heads += ["without coding", "coding adds", "margin", "verdict"]
    yield from aligned([heads, *(_odometry_cells(row, style) for row in rows)])
    yield f"Lowest rate from which on coding adds less than the margin; more columns: {path}"


def _odometry_cells(row: Row, style: FigureStyle) -> list[str]:
    def length(name: str, sign: str = "") -> str:
        return f"{float(row[name]):{sign}.3g} {row['unit']}" if row[name] else ""

    return [
        style.title(row["dataset"]),
        f"{row['odometry']}, {style.of_codec(row['codec']).title}{_TIMES.get(row['times'], '')}",
        row["rate"],
        f"{float(row['bits']):.3g}" if row["bits"] else "",
        *(length("undecoded"), length("difference", "+"), length("margin")),
        row["verdict"],
    ]


_LINES: dict[str, Callable[[Path, FigureStyle, str], Iterable[str]]] = {
    "summary": _median_lines,
    "drives": _drive_lines,
    "odometry_bits": _odometry_lines,
    "left_out": lambda *_: (),  # the caller prints it
}
"""Tables that the closing lines show, with the functions that yield these lines."""


def summary_rows(results: Path, style: FigureStyle, anchor: str) -> list[dict[str, Any]]:
    """Return the summary of a run, as one dictionary for each data set and codec.

    Parameters
    ----------
    results
        The results folder.
    style
        Style with the titles of data sets and codecs.
    anchor
        Name of the codec against which BD-rates compare.

    Returns
    -------
    list[dict[str, Any]]
        Titles (``dataset``, ``codec``), the number of ``clouds``, the smallest and the largest
        median over the rates of ``bpp``, ``d1_rms_m`` and ``d1_psnr``, the PSNR's ``peak`` and its
        ``unit``, ``lossless`` rates, ``seconds`` to encode and decode at the slowest rate, and the
        BD-rate as number (``bd_rate_percent``) and text (``bd_rate``).
    """
    medians = _rows(results / "tables" / "summary.csv")
    deltas = {
        (row["dataset"], row["codec"]): row
        for row in _rows(results / "tables" / "bd_rate.csv")
        if row["metric"] == "d1_psnr"
    }
    return [
        _row([row for row in medians if (row["dataset"], row["codec"]) == key], style)
        | _delta(None if key[1] == anchor else deltas.get(key))
        for key in dict.fromkeys((row["dataset"], row["codec"]) for row in medians)
    ]


def _delta(row: Row | None) -> dict[str, Any]:
    value = float(row["bd_rate_percent"]) if row is not None and has_delta(row) else None
    return {"bd_rate_percent": value, "bd_rate": "" if row is None else delta_text(row)}


def _remarks(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    peaks = {row["dataset"]: f"{row['peak']:g}{row['unit']}" for row in rows if row["peak"]}
    if peaks:
        yield f"Peak of the PSNRs: {', '.join(' '.join(item) for item in peaks.items())}."
    exact = [row for row in rows if row["lossless"]]
    if exact:
        named = (f"{row['dataset']}, {row['codec']} {', '.join(row['lossless'])}" for row in exact)
        yield f"Lossless, so without PSNR and in no BD-rate: {'; '.join(named)}."


def _rate_lines(results: Path, style: FigureStyle) -> Iterator[str]:
    path = results / "tables" / "rates.csv"
    rows = _rows(path)
    if len(rows) > _MAX_RATES:
        yield f"Bytes, errors and times at each rate: {path}"
    elif rows:
        yield ""
        names = [name for name in _RATE_COLUMNS if any(row.get(name) for row in rows)]
        heads = ["data set", "codec and rate", *(column_named(name).heading for name in names)]
        yield from aligned([heads, *(_rate_cells(row, names, style) for row in rows)])
        yield "99 % and largest: point to point, of the worst cloud; times for a million points."
        yield from _content_lines(rows, style)


def _content_lines(rows: Sequence[Row], style: FigureStyle) -> Iterator[str]:
    """Yield lines that tell what the streams of the column "file / stream" contain."""
    codecs: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        if row.get("coded"):
            key = style.title(row["dataset"]), row["coded"], row.get("not_coded", "")
            codecs.setdefault(key, []).append(style.of_codec(row["codec"]).title)
    for (dataset, coded, left), names in codecs.items():
        more = f"; files also {left}" if left else ""
        who = ", ".join(dict.fromkeys(names))
        yield f"file / stream, {dataset}: streams of {who} contain {coded}{more}."


def _rate_cells(row: Row, names: Sequence[str], style: FigureStyle) -> list[str]:
    return [
        style.title(row["dataset"]),
        f"{style.of_codec(row['codec']).title} {row['rate']}",
        *(f"{float(row[name]):.3g}" if row[name] else "" for name in names),
    ]


def _odd_results(results: Path) -> Iterator[str]:
    rows = [row for row in _rows(results / "tables" / "metrics.csv") if row.get(REMARK)]
    for row in rows[:_MAX_REMARKS]:
        place = f"codec {row['codec']}, cloud {row['dataset']}/{row['cloud']}, {row['rate']}"
        yield f"odd: {place}: {row[REMARK]}"
    if len(rows) > _MAX_REMARKS:
        yield f"odd: {len(rows) - _MAX_REMARKS} more rows (column {REMARK} of tables/metrics.csv)"


def _row(medians: Sequence[Row], style: FigureStyle) -> dict[str, Any]:
    first = medians[0]
    ranges = {name: _range(medians, name) for name in _RANGES}
    return {
        "dataset": style.title(first["dataset"]),
        "codec": style.of_codec(first["codec"]).title,
        "clouds": int(first["clouds"]),
        **ranges,
        "peak": float(first["peak"]) if first.get("peak") else None,
        "unit": " m" if first.get("frame") == "metric" else "",
        "lossless": [row["rate"] for row in medians if float(row.get("lossless") or 0)],
        "seconds": max(float(row["encode_s"]) + float(row["decode_s"]) for row in medians),
    }


def _range(rows: Sequence[Row], column: str) -> list[float] | None:
    values = [float(row[column]) for row in rows if row.get(column)]
    return [min(values), max(values)] if values else None


def aligned(rows: Sequence[Sequence[str]], left: int = 2) -> Iterator[str]:
    """Yield a line of text for each row of cells, with columns of equal width.

    The first `left` columns are aligned left, the others right. Each column is as wide as its
    longest cell.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [
            f"{cell:{'<' if place < left else '>'}{width}}"
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  ".join(cells).rstrip()


def _rows(path: Path) -> list[Row]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
