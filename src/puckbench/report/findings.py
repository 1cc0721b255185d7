"""What a run found, first of all: which codec needs the fewest bits, lies nearest, is fastest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any

from puckbench.figures.binning import ordered_rates
from puckbench.figures.style import FigureStyle
from puckbench.report.curves import codec_payload
from puckbench.report.quantities import measured

if TYPE_CHECKING:
    import pandas as pd

_NEAREST = ("truth_d2_rms_m", "truth_cd_plane")
"""Distances to the true surface, of which the first that a table has is told."""
FASTEST = "Fastest"
"""Under what the codecs with the least times are told."""
_REFERENCE = "reference"
_EXACT = 1e-4
"""Of a scan nearer to the truth (a tenth of a millimetre) nothing is told: it has no errors."""


@dataclass(frozen=True)
class Cell:
    """A value of a codec with a remark; `rank` orders the codecs, None where it cannot.

    is_clear: whether it differs from the reference's by more than its interval.
    """

    text: str = "\N{EN DASH}"
    note: str = ""
    rank: float | None = None
    is_clear: bool = True


@dataclass(frozen=True)
class Column:
    """A quantity of all codecs, less being better.

    Parameters
    ----------
    head
        Its name.
    group, purpose
        Under what its best codec is told, nothing where it is not, and what is said behind its
        value.
    cells
        Codec -> value.
    """

    head: str
    group: str
    purpose: str
    cells: Mapping[str, Cell]

    @property
    def best(self) -> tuple[str, ...]:
        """The codecs with the lowest value; none where fewer than two have a rank."""
        ranks = {codec: cell.rank for codec, cell in self.cells.items() if cell.rank is not None}
        lowest = min(ranks.values(), default=None)
        return tuple(c for c, rank in ranks.items() if rank == lowest) if len(ranks) > 1 else ()


@dataclass(frozen=True)
class DatasetFindings:
    """What was found on one data set: who is best at what, and all codecs' values.

    codecs: as `puckbench.report.curves.codec_payload` describes them.
    """

    title: str
    clouds: int
    best: Mapping[str, str]
    columns: tuple[Column, ...]
    codecs: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class Findings:
    """The findings of a run; `anchor` is the title of the codec that bits are compared with."""

    datasets: tuple[DatasetFindings, ...]
    anchor: str = ""

    @property
    def is_timed(self) -> bool:
        """Whether times are among them."""
        return any(column.group == FASTEST for data in self.datasets for column in data.columns)


def findings(
    metrics: pd.DataFrame,
    deltas: pd.DataFrame | None,
    scan_errors: pd.DataFrame | None,
    style: FigureStyle,
) -> Findings:
    """The findings of a run.

    Parameters
    ----------
    metrics
        All results.
    deltas
        The table ``bd_rate``, where there is one.
    scan_errors
        Errors of the scans themselves, where there are any.
    style
        Gives titles and orders.
    """
    anchor = "" if deltas is None else style.of_codec(deltas["anchor"].iloc[0]).title
    found = [
        _of_dataset(
            name, _rows(metrics, name), _rows(deltas, name), _rows(scan_errors, name), style
        )
        for name in style.ordered_datasets(metrics["dataset"])
    ]
    return Findings(tuple(found), anchor)


def _rows(table: pd.DataFrame | None, dataset: str) -> Any:
    return None if table is None else table[table["dataset"] == dataset]


def _of_dataset(
    name: str,
    metrics: pd.DataFrame,
    deltas: pd.DataFrame | None,
    errors: pd.DataFrame | None,
    style: FigureStyle,
) -> DatasetFindings:
    codecs = style.ordered_codecs(metrics["codec"])
    columns = [*_bits(deltas, codecs), *_nearest(metrics, errors, codecs), *_times(metrics, codecs)]
    best: dict[str, str] = {}
    for column in columns:
        if column.group and (told := _told(column, style)):
            best[column.group] = "; ".join(filter(None, (best.get(column.group), told)))
    shown = tuple(codec_payload(codec, style) for codec in codecs)
    clouds = metrics["cloud"].nunique()
    return DatasetFindings(style.title(name), clouds, best, tuple(columns), shown)


def _told(column: Column, style: FigureStyle) -> str:
    """Which codec is the best of a column, with its value; empty where none is."""
    if not column.best:
        return ""
    title, cell = style.of_codec(column.best[0]).title, column.cells[column.best[0]]
    rivals = column.cells.values() if cell.note == _REFERENCE else [cell]
    if any(rival.rank is not None and not rival.is_clear for rival in rivals):
        return f"no clear winner{column.purpose}"
    remark = f" ({cell.note})" if cell.note else ""
    return f"{title}: {cell.text}{column.purpose}{remark}"


def _bits(deltas: pd.DataFrame | None, codecs: Sequence[str]) -> Iterator[Column]:
    """BD-rates of every codec, a column for each measure of quality."""
    if deltas is None:
        return
    for metric, rows in deltas.groupby("metric", sort=False):
        quality = _short(str(metric))
        cells = _bd_rates(rows, codecs)
        yield Column(f"BD-rate, {quality}", "Fewest bits", f" for equal {quality}", cells)


def _short(metric: str) -> str:
    """The name of a quality for a narrow column: D1 for d1_psnr."""
    known = metric.removesuffix("_psnr")
    return known.upper() if known in ("d1", "d2") else measured(metric).words


def _bd_rates(rows: pd.DataFrame, codecs: Sequence[str]) -> dict[str, Cell]:
    by_codec = rows.set_index("codec").to_dict("index")
    anchor = rows["anchor"].iloc[0]
    return {
        codec: Cell("0 %", _REFERENCE, 0.0) if codec == anchor else _bd_rate(by_codec.get(codec))
        for codec in codecs
    }


def _bd_rate(row: Mapping[Any, Any] | None) -> Cell:
    """One BD-rate; a codec that shares no range on some clouds is not ranked with the others."""
    if row is None or not row["compared"]:
        return Cell(note="no common range")
    value, low, high = (row[f"bd_rate_percent{end}"] for end in ("", "_low", "_high"))
    notes = [] if isnan(low) else [f"{percent_text(low)} to {percent_text(high)}"]
    whole = row["compared"] == row["clouds"]
    notes += [] if whole else [f"{row['compared']} of {row['clouds']} clouds"]
    is_clear = not low <= 0 <= high  # of one cloud there is no interval
    return Cell(percent_text(value), ", ".join(notes), float(value) if whole else None, is_clear)


def percent_text(value: float) -> str:
    """A change in percent, with its sign: −53.6 %, +118 %."""
    text = f"{abs(value):.0f}" if abs(value) >= 100 else f"{abs(value):.1f}"
    sign = "\N{MINUS SIGN}" if value < 0 else "+"
    return f"{sign}{text}\N{NO-BREAK SPACE}%"


def _nearest(
    metrics: pd.DataFrame, errors: pd.DataFrame | None, codecs: Sequence[str]
) -> Iterator[Column]:
    """The least distance to the true surface at any rate, and where it is reached."""
    column = _distance_of(metrics)
    if column is not None:
        medians = metrics.groupby(["codec", "rate"])[[column, "bpp"]].median()
        cells = {codec: _least(medians, column, codec) for codec in codecs}
        own = _own_error(errors, column)
        # Of a scan without errors the finest rate is the nearest, which tells nothing.
        yield Column("Distance to the truth", "Nearest to the truth" if own else "", own, cells)


def _distance_of(table: pd.DataFrame) -> str | None:
    return next((name for name in _NEAREST if name in table and table[name].notna().any()), None)


def _least(medians: pd.DataFrame, column: str, codec: str) -> Cell:
    own = medians.loc[codec].dropna()
    if own.empty:
        return Cell()
    values, bpp = (
        dict(zip(own.index, own[name].tolist(), strict=True)) for name in (column, "bpp")
    )
    rate = min(ordered_rates(set(values)), key=lambda name: values[name])
    return Cell(distance_text(values[rate], column), f"{rate}, {bpp[rate]:.3g} bpp", values[rate])


def distance_text(value: float, column: str) -> str:
    """A distance with its unit: metres as millimetres."""
    if measured(column).unit == "m":
        return f"{value * 1000:.3g}\N{NO-BREAK SPACE}mm"
    return f"{value:.3g} {measured(column).unit}".replace(" ", "\N{NO-BREAK SPACE}")


def _own_error(errors: pd.DataFrame | None, column: str) -> str:
    """How far the scans themselves lie from the truth, where they have errors."""
    value = 0.0 if errors is None or column not in errors else float(errors[column].median())
    return f", the scan itself {distance_text(value, column)}" if value > _EXACT else ""


def _times(metrics: pd.DataFrame, codecs: Sequence[str]) -> Iterator[Column]:
    """Medians of the times over clouds and rates."""
    for way, purpose in {"encode": " to encode", "decode": " to decode"}.items():
        if f"{way}_s" in metrics:
            medians = metrics.groupby("codec")[f"{way}_s"].median()
            cells = {codec: _seconds(float(medians[codec])) for codec in codecs}
            yield Column(f"Time{purpose}", FASTEST, purpose, cells)


def _seconds(value: float) -> Cell:
    return Cell() if isnan(value) else Cell(f"{value:.2g}\N{NO-BREAK SPACE}s", "", value)
