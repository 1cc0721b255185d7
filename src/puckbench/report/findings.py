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
from puckbench.metrics.timing import unranked_codecs
from puckbench.report.bd_rate_text import delta_note, delta_value, has_delta, holds_zero
from puckbench.report.column_labels import column_label
from puckbench.report.plot_data import codec_payload

if TYPE_CHECKING:
    import pandas as pd

_NEAREST = ("truth_d2_rms_m", "truth_cd_plane")
"""Metrics of distance to the true surface; the first that a table contains is used."""
FASTEST = "Fastest"
"""Group of the columns with times."""
_REFERENCE = "reference"
_EXACT = 1e-4
"""Distance to the true surface (m, or squared grid units) below which a scan counts as exact."""


@dataclass(frozen=True)
class Cell:
    """A codec's value as text, with a note; `rank` is the sorting key, None if unranked."""

    text: str = "\N{EN DASH}"
    note: str = ""
    rank: float | None = None


@dataclass(frozen=True)
class FindingsColumn:
    """The values of all codecs in a metric; lower values are better.

    `group` and `purpose` are words for the statement on the best codec; `ties` are codecs that are
    not significantly worse than the best.
    """

    head: str
    group: str
    purpose: str
    cells: Mapping[str, Cell]
    ties: tuple[str, ...] = ()

    @property
    def ranking(self) -> tuple[str, ...]:
        """Ranked codecs, the lowest value first; empty if only one codec is ranked."""
        ranks = {codec: cell.rank for codec, cell in self.cells.items() if cell.rank is not None}
        return tuple(sorted(ranks, key=lambda codec: ranks[codec] or 0)) if len(ranks) > 1 else ()

    @property
    def best(self) -> str | None:
        """The codec with the lowest value, if it is significantly lowest."""
        return self.ranking[0] if self.ranking and not self.ties else None

    def tested(self, is_better: Callable[[str, str], bool]) -> FindingsColumn:
        """Return the column with its ties: codecs for which ``is_better(best, codec)`` is false."""
        best, *others = self.ranking or ("",)
        return replace(self, ties=tuple(c for c in others if not is_better(best, c)))


@dataclass(frozen=True)
class DatasetFindings:
    title: str
    clouds: int
    best: Mapping[str, str]
    columns: tuple[FindingsColumn, ...]
    codecs: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class Findings:
    datasets: tuple[DatasetFindings, ...]
    anchor: str = ""
    lossless: str = ""

    @property
    def is_timed(self) -> bool:
        return any(column.group == FASTEST for data in self.datasets for column in data.columns)


def findings(
    metrics: pd.DataFrame,
    deltas: pd.DataFrame | None,
    scan_errors: pd.DataFrame | None,
    style: FigureStyle,
) -> Findings:
    anchor = "" if deltas is None else style.of_codec(deltas["anchor"].iloc[0]).title
    datasets = [
        _of_dataset(
            name, _rows(metrics, name), _rows(deltas, name), _rows(scan_errors, name), style
        )
        for name in style.ordered_datasets(metrics["dataset"])
    ]
    return Findings(tuple(datasets), anchor, lossless_text(metrics, style))


def lossless_text(metrics: pd.DataFrame, style: FigureStyle) -> str:
    """Return the lossless rates by codec, such as "G-PCC 1mm (3 clouds)", or an empty string."""
    rows = metrics[lossless_rows(metrics)]
    texts = []
    for codec in style.ordered_codecs(rows["codec"]):
        codec_rows = rows[rows["codec"] == codec]
        clouds = len(codec_rows[["dataset", "cloud"]].drop_duplicates())
        rates = ", ".join(ordered_rates(set(codec_rows["rate"])))
        cloud_count = "1 cloud" if clouds == 1 else f"{clouds} clouds"
        texts.append(f"{style.of_codec(codec).title} {rates} ({cloud_count})")
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
        if column.group and (text := _best_text(column, style)):
            best[column.group] = "; ".join(filter(None, (best.get(column.group), text)))
    described_codecs = tuple(codec_payload(codec, style) for codec in codecs)
    clouds = metrics["cloud"].nunique()
    return DatasetFindings(style.title(name), clouds, best, tuple(columns), described_codecs)


def _best_text(column: FindingsColumn, style: FigureStyle) -> str:
    if not column.ranking:
        return ""
    first = column.ranking[0]
    titles = {codec: style.of_codec(codec).title for codec in column.cells}
    if column.best is None:
        titles_of_ties = ", ".join(titles[codec] for codec in (first, *column.ties))
        return f"no clear winner{column.purpose} ({titles_of_ties})"
    cell, ranked = column.cells[first], len(column.ranking)
    part = "" if ranked == len(titles) else f"{ranked} of {len(titles)} codecs compared"
    remark = ", ".join(filter(None, (cell.note, part)))
    return f"{titles[first]}: {cell.text}{column.purpose}{f' ({remark})' if remark else ''}"


def _bits(
    metrics: pd.DataFrame, deltas: pd.DataFrame | None, codecs: Sequence[str]
) -> Iterator[FindingsColumn]:
    if deltas is None:
        return
    for metric, rows in deltas.groupby("metric", sort=False):
        quality = _short(str(metric))
        cells = _bd_rates(rows, codecs)
        column = FindingsColumn(
            f"BD-rate, {quality}", "Fewest bits", f" for equal {quality}", cells
        )
        yield column.tested(_needs_fewer_bits(metrics, rows, str(metric)))


def _needs_fewer_bits(
    metrics: pd.DataFrame, rows: pd.DataFrame, metric: str
) -> Callable[[str, str], bool]:
    anchor, by_codec = rows["anchor"].iloc[0], rows.set_index("codec").to_dict("index")

    def is_better(first: str, other: str) -> bool:
        if anchor in (first, other):
            return not holds_zero(by_codec[other if first == anchor else first])
        return is_below_zero(log_ratios(metrics, other, first, metric))

    return is_better


def _short(metric: str) -> str:
    bare = metric.removesuffix("_psnr")
    return bare.upper() if bare in ("d1", "d2") else column_label(metric).words


def _bd_rates(rows: pd.DataFrame, codecs: Sequence[str]) -> dict[str, Cell]:
    by_codec = rows.set_index("codec").to_dict("index")
    anchor = rows["anchor"].iloc[0]
    return {
        codec: Cell("0 %", _REFERENCE, 0.0) if codec == anchor else _bd_rate(by_codec.get(codec))
        for codec in codecs
    }


def _bd_rate(row: Mapping[Any, Any] | None) -> Cell:
    if row is None or not has_delta(row):
        return Cell(note=delta_note(row))
    is_whole = row["compared"] == row["clouds"]
    rank = float(row["bd_rate_percent"]) if is_whole else None
    return Cell(delta_value(row), delta_note(row), rank)


def _nearest(
    metrics: pd.DataFrame, errors: pd.DataFrame | None, codecs: Sequence[str]
) -> Iterator[FindingsColumn]:
    distance = _distance_of(metrics)
    if distance is not None:
        medians = metrics.groupby(["codec", "rate"])[[distance, "bpp"]].median().dropna()
        rates = {codec: _nearest_rate(medians[distance], codec) for codec in codecs}
        cells = {codec: _least(medians, rates[codec], codec) for codec in codecs}
        scan_error = _scan_error_text(errors, distance)
        # The finest rate is always the nearest to a scan without errors, so no statement is made.
        group = "Nearest to the truth" if scan_error else ""
        column = FindingsColumn("Distance to the truth", group, scan_error, cells)
        yield column.tested(
            _is_less(metrics[metrics["rate"] == metrics["codec"].map(rates)], distance)
        )


def _distance_of(table: pd.DataFrame) -> str | None:
    return next((name for name in _NEAREST if name in table and table[name].notna().any()), None)


def _nearest_rate(distances: pd.Series[float], codec: str) -> str | None:
    rows = zip(*map(distances.index.get_level_values, ("codec", "rate")), distances, strict=True)
    distance_of_rate = {rate: value for name, rate, value in rows if name == codec}
    return min(
        ordered_rates(set(distance_of_rate)), key=lambda name: distance_of_rate[name], default=None
    )


def _least(medians: pd.DataFrame, rate: str | None, codec: str) -> Cell:
    if rate is None:
        return Cell()
    distance = str(medians.columns[0])
    value, bpp = (float(medians[name].to_dict()[codec, rate]) for name in (distance, "bpp"))
    return Cell(distance_text(value, distance), f"{rate}, {bpp:.3g} bpp", value)


def distance_text(value: float, column: str) -> str:
    if column_label(column).unit == "m":
        return f"{value * 1000:.3g}\N{NO-BREAK SPACE}mm"
    return f"{value:.3g} {column_label(column).unit}".replace(" ", "\N{NO-BREAK SPACE}")


def _scan_error_text(errors: pd.DataFrame | None, column: str) -> str:
    value = 0.0 if errors is None or column not in errors else float(errors[column].median())
    return f", the scan itself {distance_text(value, column)}" if value > _EXACT else ""


def _times(metrics: pd.DataFrame, codecs: Sequence[str]) -> Iterator[FindingsColumn]:
    for way, purpose in {"encode": " to encode", "decode": " to decode"}.items():
        if f"{way}_s" in metrics:
            medians = metrics.groupby("codec")[f"{way}_s"].median()
            unranked = unranked_codecs(metrics)
            cells = {codec: _seconds(float(medians[codec]), codec in unranked) for codec in codecs}
            column = FindingsColumn(f"Time{purpose}", FASTEST, purpose, cells)
            yield column.tested(_is_less(metrics, f"{way}_s"))


def _is_less(metrics: pd.DataFrame, column: str) -> Callable[[str, str], bool]:
    medians = metrics.groupby(["cloud", "codec"])[column].median().unstack()

    def is_less(first: str, other: str) -> bool:
        pairs = medians[[first, other]].dropna()
        tested, reference = pairs[(pairs > 0).all(axis="columns")].to_numpy(float).T
        return is_below_zero(np.log(tested / reference))

    return is_less


def _seconds(value: float, unranked: bool) -> Cell:
    if isnan(value):
        return Cell()
    text = f"{value:.2g}\N{NO-BREAK SPACE}s"
    note = "not ranked" if unranked else ""
    return Cell(text, note, None if unranked else value)
