from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from pointkit.geometry.cloud import CoordinateFrame, Floats
from puckbench.figures.binning import ordered_rates
from puckbench.figures.style import FigureStyle
from puckbench.metrics.coordinate_frames import frames_of
from puckbench.metrics.lossless import with_lossless_best, without_lossless
from puckbench.metrics.peaks import WITH_PEAK, peak_phrase, without_mixed_peaks
from puckbench.metrics.statistics import MIN_SCENES
from puckbench.results.columns import OTHER, PLOTTED, Column, column_named, unit_in_frames

if TYPE_CHECKING:
    import pandas as pd

_KEYS = ["dataset", "codec", "rate"]
_SHARES = [0.25, 0.5, 0.75]
_DIGITS = 5


def plot_payload(metrics: pd.DataFrame, style: FigureStyle) -> dict[str, Any]:
    """Return the data of the page's interactive plot, as a JSON object.

    Parameters
    ----------
    metrics
        Results of a run.
    style
        Style of the figures.

    Returns
    -------
    dict
        ``datasets``, ``codecs`` and ``metrics`` describe what can be chosen. ``cells`` has an entry
        for each data set, codec and rate: the number of ``clouds``, and ``values``, which maps
        columns to [first quartile, median, third quartile] over clouds.
    """
    metrics = with_lossless_best(without_mixed_peaks(metrics))
    shown, frames = _shown(metrics), frames_of(metrics)
    datasets = style.ordered_datasets(metrics["dataset"])
    codecs = style.ordered_codecs(metrics["codec"])
    return {
        "datasets": [
            {"name": name, "title": style.title(name), "frame": _frame_of(metrics, name)}
            for name in datasets
        ],
        "codecs": [codec_payload(name, style) for name in codecs],
        "metrics": [_described(each, frames) for each in shown if each.name != "bpp"],
        "cells": _cells(metrics, [each.name for each in shown], datasets, codecs),
    }


def codec_payload(codec: str, style: FigureStyle) -> dict[str, str]:
    """Return name, title, colour, marker and line of a codec, as a JSON object."""
    from matplotlib.colors import to_hex

    plot_style = style.of_codec(codec)
    return {
        "name": codec,
        "title": plot_style.title,
        "colour": to_hex(plot_style.colour),
        "marker": plot_style.marker,
        "line": plot_style.line,
    }


def _shown(metrics: pd.DataFrame) -> list[Column]:
    """Return the columns that the plot offers: numbers that depend on codec or rate."""
    numbers = metrics.select_dtypes("number").dropna(axis="columns", how="all")
    names = [str(name) for name in numbers]
    different = metrics.groupby(["dataset", "cloud"])[names].nunique().max() > 1
    shown = [each for each in map(column_named, names) if each.group in PLOTTED]
    shown = [each for each in shown if each.group != OTHER or different[each.name]]
    shown.sort(key=lambda each: PLOTTED.index(each.group))
    peak = peak_phrase(metrics)
    return [_with_peak(each, peak) for each in shown]


def _with_peak(shown: Column, peak: str) -> Column:
    has_peak = shown.name in WITH_PEAK and peak
    return replace(shown, words=f"{shown.words}, {peak}") if has_peak else shown


def _frame_of(metrics: pd.DataFrame, dataset: str) -> CoordinateFrame:
    frames = frames_of(metrics[metrics["dataset"] == dataset])
    return "metric" if "metric" in frames else "scaled"


def _described(shown: Column, frames: Collection[str]) -> dict[str, Any]:
    return {
        "name": shown.name,
        "words": shown.words,
        "unit": unit_in_frames(shown.unit, frames),
        "units": {each: unit_in_frames(shown.unit, {each}) for each in get_args(CoordinateFrame)},
        "group": shown.group,
    }


def _cells(
    metrics: pd.DataFrame, columns: list[str], datasets: list[str], codecs: list[str]
) -> list[dict[str, Any]]:
    import pandas as pd

    rates, places = ordered_rates(set(metrics["rate"])), metrics.groupby(_KEYS).indices
    keys = [(d, c, r) for d in datasets for c in codecs for r in rates if (d, c, r) in places]
    numbers = metrics[columns].astype(float).to_numpy()
    if not keys:
        return []
    quartiles = np.concatenate([_quartiles(numbers[places[key]]) for key in keys])
    known = without_lossless(pd.DataFrame(quartiles, columns=columns)).to_numpy()
    cells = []
    for key, values in zip(keys, known.reshape(len(keys), len(_SHARES), -1), strict=True):
        shown = {
            name: round_significant(quartiles_of_column)
            for name, quartiles_of_column in zip(columns, values.T, strict=True)
            if not np.isnan(quartiles_of_column).any()
        }
        head = dict(zip(_KEYS, key, strict=True))
        cells.append({**head, "clouds": len(places[key]), "values": shown})
    return cells


def _quartiles(values: Floats) -> Floats:
    """Return the quartiles of each column, (3, columns), of values (n, columns), ignoring nan.

    This is much faster than quantiles of a wide data frame. With fewer than six rows, the median
    stands for all three quartiles.
    """
    shares = _SHARES if len(values) >= MIN_SCENES else [0.5] * len(_SHARES)
    quartiles = np.full((len(shares), values.shape[1]), np.nan)
    is_missing = np.isnan(values)
    whole = ~is_missing.any(axis=0)
    quartiles[:, whole] = np.quantile(values[:, whole], shares, axis=0)
    for place in np.flatnonzero(~whole & ~is_missing.all(axis=0)):
        present = values[~is_missing[:, place], place]
        quartiles[:, place] = np.quantile(present, shares)
    return quartiles


def round_significant(values: Any, digits: int = _DIGITS) -> list[float]:
    """Return values as a list of numbers, rounded to significant digits."""
    return [float(f"{value:.{digits}g}") for value in np.asarray(values, dtype=float)]
