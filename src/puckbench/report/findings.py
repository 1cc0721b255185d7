"""What a run found, first of all: which codec needs the fewest bits, lies nearest, is fastest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isnan
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.figures.binning import ordered_rates
from puckbench.figures.style import FigureStyle
from puckbench.metrics.lossless import lossless_rows
from puckbench.metrics.tables.rate_deltas import is_below_zero, log_ratios
from puckbench.report.bd_rate_text import delta_note, delta_value, has_delta, holds_zero
from puckbench.report.column_labels import measured
from puckbench.report.plot_data import codec_payload

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
    """A value of a codec with a remark; `rank` orders the codecs, None where it cannot."""

    text: str = "\N{EN DASH}"
    note: str = ""
    rank: float | None = None


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
    rivals
        Codecs that the first is not better than beyond chance.
    """

    head: str
    group: str
    purpose: str
    cells: Mapping[str, Cell]
    rivals: tuple[str, ...] = ()

    @property
    def ranking(self) -> tuple[str, ...]:
        """The codecs that have a rank, the lowest first; none where only one has."""
        ranks = {codec: cell.rank for codec, cell in self.cells.items() if cell.rank is not None}
        return tuple(sorted(ranks, key=lambda codec: ranks[codec] or 0)) if len(ranks) > 1 else ()

    @property
    def best(self) -> str | None:
        """The codec with the lowest value, where it is the lowest beyond chance."""
        return self.ranking[0] if self.ranking and not self.rivals else None

    def tested(self, is_better: Callable[[str, str], bool]) -> Column:
        """The column with the test of its first codec against each other that has a rank."""
        first, *others = self.ranking or ("",)
        return replace(self, rivals=tuple(c for c in others if not is_better(first, c)))


@dataclass(frozen=True)
class DatasetFindings:
    """What was found on one data set: who is best at what, and all codecs' values.

    codecs: as `puckbench.report.plot_data.codec_payload` describes them.
    """

    title: str
    clouds: int
    best: Mapping[str, str]
    columns: tuple[Column, ...]
    codecs: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class Findings:
    """The findings of a run.

    Parameters
    ----------
    datasets
        What was found on each.
    anchor
        Title of the codec that bits are compared with.
    lossless
        The lossless rates of each codec, in words; empty where there are none.
    """

    datasets: tuple[DatasetFindings, ...]
    anchor: str = ""
    lossless: str = ""

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
    return Findings(tuple(found), anchor, lossless_text(metrics, style))


def lossless_text(metrics: pd.DataFrame, style: FigureStyle) -> str:
    """Lossless rates by codec, such as "G-PCC 1mm (3 clouds)"; empty where there are none."""
    rows = metrics[lossless_rows(metrics)]
    texts = []
    for codec in style.ordered_codecs(rows["codec"]):
        own = rows[rows["codec"] == codec]
        clouds = len(own[["dataset", "cloud"]].drop_duplicates())
        rates = ", ".join(ordered_rates(set(own["rate"])))
        counted = "1 cloud" if clouds == 1 else f"{clouds} clouds"
        texts.append(f"{style.of_codec(codec).title} {rates} ({counted})")
    return "; ".join(texts)


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
    columns = [
        *_bits(metrics, deltas, codecs),
        *_nearest(metrics, errors, codecs),
        *_times(metrics, codecs),
    ]
    best: dict[str, str] = {}
    for column in columns:
        if column.group and (told := _told(column, style)):
            best[column.group] = "; ".join(filter(None, (best.get(column.group), told)))
    shown = tuple(codec_payload(codec, style) for codec in codecs)
    clouds = metrics["cloud"].nunique()
    return DatasetFindings(style.title(name), clouds, best, tuple(columns), shown)


def _told(column: Column, style: FigureStyle) -> str:
    """Which codec is the best of a column, with its value; empty where none is."""
    if not column.ranking:
        return ""
    first = column.ranking[0]
    titles = {codec: style.of_codec(codec).title for codec in column.cells}
    if column.best is None:
        named = ", ".join(titles[codec] for codec in (first, *column.rivals))
        return f"no clear winner{column.purpose} ({named})"
    cell, ranked = column.cells[first], len(column.ranking)
    part = "" if ranked == len(titles) else f"{ranked} of {len(titles)} codecs compared"
    remark = ", ".join(filter(None, (cell.note, part)))
    return f"{titles[first]}: {cell.text}{column.purpose}{f' ({remark})' if remark else ''}"


def _bits(
    metrics: pd.DataFrame, deltas: pd.DataFrame | None, codecs: Sequence[str]
) -> Iterator[Column]:
    """BD-rates of every codec, a column for each measure of quality."""
    if deltas is None:
        return
    for metric, rows in deltas.groupby("metric", sort=False):
        quality = _short(str(metric))
        cells = _bd_rates(rows, codecs)
        column = Column(f"BD-rate, {quality}", "Fewest bits", f" for equal {quality}", cells)
        yield column.tested(_needs_fewer_bits(metrics, rows, str(metric)))


def _needs_fewer_bits(
    metrics: pd.DataFrame, rows: pd.DataFrame, metric: str
) -> Callable[[str, str], bool]:
    """Whether a codec's BD-rate against another is negative beyond chance.

    That of one of them against the anchor is in the table; others are compared with each other.
    """
    anchor, by_codec = rows["anchor"].iloc[0], rows.set_index("codec").to_dict("index")

    def is_better(first: str, other: str) -> bool:
        if anchor in (first, other):
            return not holds_zero(by_codec[other if first == anchor else first])
        return is_below_zero(log_ratios(metrics, other, first, metric))

    return is_better


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
    """One BD-rate; a codec that cannot be compared on some clouds is not ranked with the others."""
    if row is None or not has_delta(row):
        return Cell(note=delta_note(row))
    is_whole = row["compared"] == row["clouds"]
    rank = float(row["bd_rate_percent"]) if is_whole else None
    return Cell(delta_value(row), delta_note(row), rank)


def _nearest(
    metrics: pd.DataFrame, errors: pd.DataFrame | None, codecs: Sequence[str]
) -> Iterator[Column]:
    """The least distance to the true surface at any rate, and where it is reached."""
    distance = _distance_of(metrics)
    if distance is not None:
        medians = metrics.groupby(["codec", "rate"])[[distance, "bpp"]].median().dropna()
        rates = {codec: _nearest_rate(medians[distance], codec) for codec in codecs}
        cells = {codec: _least(medians, rates[codec], codec) for codec in codecs}
        own = _own_error(errors, distance)
        # Of a scan without errors the finest rate is the nearest, which tells nothing.
        group = "Nearest to the truth" if own else ""
        column = Column("Distance to the truth", group, own, cells)
        yield column.tested(
            _is_less(metrics[metrics["rate"] == metrics["codec"].map(rates)], distance)
        )


def _distance_of(table: pd.DataFrame) -> str | None:
    return next((name for name in _NEAREST if name in table and table[name].notna().any()), None)


def _nearest_rate(distances: pd.Series[float], codec: str) -> str | None:
    rows = zip(*map(distances.index.get_level_values, ("codec", "rate")), distances, strict=True)
    own = {rate: value for name, rate, value in rows if name == codec}
    return min(ordered_rates(set(own)), key=lambda name: own[name], default=None)


def _least(medians: pd.DataFrame, rate: str | None, codec: str) -> Cell:
    if rate is None:
        return Cell()
    distance = str(medians.columns[0])
    value, bpp = (float(medians[name].to_dict()[codec, rate]) for name in (distance, "bpp"))
    return Cell(distance_text(value, distance), f"{rate}, {bpp:.3g} bpp", value)


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
            column = Column(f"Time{purpose}", FASTEST, purpose, cells)
            yield column.tested(_is_less(metrics, f"{way}_s"))


def _is_less(metrics: pd.DataFrame, column: str) -> Callable[[str, str], bool]:
    """Whether a codec's medians over the rates of each cloud are less than another's."""
    medians = metrics.groupby(["cloud", "codec"])[column].median().unstack()

    def is_less(first: str, other: str) -> bool:
        pairs = medians[[first, other]].dropna()
        ours, theirs = pairs[(pairs > 0).all(axis="columns")].to_numpy(float).T
        return is_below_zero(np.log(ours / theirs))

    return is_less


def _seconds(value: float) -> Cell:
    return Cell() if isnan(value) else Cell(f"{value:.2g}\N{NO-BREAK SPACE}s", "", value)
