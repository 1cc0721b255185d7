from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError
from puckbench.results.columns import FRAME

if TYPE_CHECKING:
    import pandas as pd

PEAK = "peak"
"""Column of results: the peak of ``d1_psnr`` and ``d2_psnr``, in the unit of the cloud."""
WITH_PEAK = ("d1_psnr", "d2_psnr")
_DIGITS = 4
"""Significant digits of a peak derived from rounded errors and PSNRs."""
_ALIKE = 1.001
"""Largest ratio of two peaks that count as equal."""


def with_peaks(metrics: pd.DataFrame) -> pd.DataFrame:
    """Return a results table with the column `PEAK`.

    If an older table lacks the column, the peaks are computed from ``d1_mse`` and ``d1_psnr``. If
    it lacks these too, it is returned unchanged.
    """
    if PEAK in metrics or not {"d1_mse", "d1_psnr"} <= set(metrics):
        return metrics
    peaks = np.sqrt(metrics["d1_mse"].astype(float) * 10 ** (metrics["d1_psnr"] / 10) / 3)
    medians = peaks.groupby([metrics["dataset"], metrics["cloud"]]).transform("median")
    return metrics.assign(**{PEAK: [float(f"{value:.{_DIGITS}g}") for value in medians]})


def check_peaks(metrics: pd.DataFrame, columns: Iterable[str]) -> None:
    """Raise InputError if PSNRs of one cloud were computed with different peaks.

    Parameters
    ----------
    metrics
        Table of results.
    columns
        Names of the columns to be compared. Nothing is checked if no PSNR with a peak is among
        them.
    """
    if PEAK not in metrics or not set(WITH_PEAK) & set(columns):
        return
    for (dataset, cloud), part in metrics.groupby(["dataset", "cloud"])[PEAK]:
        if part.max() > _ALIKE * part.min():
            raise InputError(
                f"PSNRs of {dataset}/{cloud} have the peaks {part.min():g} and {part.max():g}: "
                "measure all with one peak, or compare d1_mse and d2_mse"
            )


def without_mixed_peaks(metrics: pd.DataFrame) -> pd.DataFrame:
    """Return the table without the PSNRs of data sets whose results have different peaks.

    A warning names these data sets. Their PSNRs are set to nan.
    """
    if PEAK not in metrics:
        return metrics
    of_sets = metrics.groupby("dataset")[PEAK]
    mixed = of_sets.transform("max") > _ALIKE * of_sets.transform("min")
    if not mixed.any():
        return metrics
    names = ", ".join(map(str, dict.fromkeys(metrics.loc[mixed, "dataset"])))
    logging.getLogger(__name__).warning(
        f"PSNRs of {names} have several peaks: medians over clouds are left out"
    )
    columns = [name for name in WITH_PEAK if name in metrics]
    return metrics.assign(**{name: metrics[name].mask(mixed) for name in columns})


def peaks_of_datasets(metrics: pd.DataFrame) -> dict[str, str]:
    """Return the PSNR peaks of each data set as text, such as "30 m", by name of the data set."""
    table = with_peaks(metrics)
    if PEAK not in table:
        return {}
    table = table.dropna(subset=[PEAK])
    is_metric = (table[FRAME] == "metric") if FRAME in table else table[PEAK].isna()
    words = [f"{p:g}{' m' if m else ''}" for p, m in zip(table[PEAK], is_metric, strict=True)]
    distinct = table[["dataset"]].assign(words=words).drop_duplicates().groupby("dataset")["words"]
    return {str(name): " and ".join(values) for name, values in distinct}


def peak_phrase(metrics: pd.DataFrame) -> str:
    """Return all peaks of the PSNRs as text, such as "peak 1023 or 30 m"; empty without a peak."""
    several = dict.fromkeys(peaks_of_datasets(metrics).values())
    return f"peak {' or '.join(several)}" if several else ""
