"""BD-rates that sources print, computed again from the curves of the same source."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from math import isnan, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats
from puckbench.metrics.bjontegaard import bjontegaard_delta, rate_distortion_curve
from puckbench.published_sources.registry import CUBIC, Source
from puckbench.published_sources.rows import BD_RATES, rates_of

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.metrics.bjontegaard",)

_CURVE = ["dataset", "cloud", "codec", "measure"]
_DEGREE = 3
NO_CURVE = "no such curve in the source"


def polynomial_bd_rate(
    anchor_bits: Floats, anchor_quality: Floats, bits: Floats, quality: Floats
) -> float:
    """Return the BD-rate by the original method (VCEG-M33), in percent.

    A cubic polynomial is fitted to each curve (ln bits over quality), and their difference is
    averaged over the common range of qualities. With fewer than four points, the polynomial with
    the smallest coefficients is taken, as `numpy.polyfit` does.

    Parameters
    ----------
    anchor_bits, anchor_quality
        Bits (n,) and qualities (n,) in dB of the anchor.
    bits, quality
        Bits (m,) and qualities (m,) in dB of the tested codec.
    """
    low = max(anchor_quality.min(), quality.min())
    high = min(anchor_quality.max(), quality.max())
    areas = []
    for x, y in ((anchor_quality, anchor_bits), (quality, bits)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", np.exceptions.RankWarning)
            integral = np.polyint(np.polyfit(x, np.log(y), _DEGREE))
        areas.append(np.polyval(integral, high) - np.polyval(integral, low))
    return 100 * float(np.expm1((areas[1] - areas[0]) / (high - low)))


def checked_bd_rates(source: Source) -> pd.DataFrame:
    """Return the BD-rates that a source prints, beside those computed from its own curves.

    Returns
    -------
    pandas.DataFrame
        A row for each printed BD-rate: its keys, ``printed``, ``again`` (computed by the
        interpolation of the source, or by PCHIP if it names none), ``difference`` (0 if both are
        equal to the printed digit), ``pchip`` (by `puckbench.metrics.bjontegaard`, nan if its rules
        do not allow one), ``status`` (why not) and ``place``. Without curves in the source, all
        but ``printed`` are nan. The table is empty if the source prints no BD-rates.
    """
    import pandas as pd

    rows = source.rows
    curves = dict(iter(rows.groupby(_CURVE, sort=False)))
    printed = rows[rows["measure"].isin(BD_RATES)].to_dict("records")
    checked = [_checked(source, row, curves) for row in printed]
    columns = ["dataset", "cloud", "codec", "anchor", "measure", "rate", "printed", "again"]
    return pd.DataFrame(checked, columns=[*columns, "difference", "pchip", "status", "place"])


def _checked(source: Source, row: dict[Any, Any], curves: dict[Any, Any]) -> dict[str, Any]:
    kept = ("dataset", "cloud", "codec", "anchor", "measure", "rate", "place")
    keys = {**{name: row[name] for name in kept}, "printed": row["value"]}
    tested, anchor = (
        _part(curves, (row["dataset"], row["cloud"], codec, BD_RATES[row["measure"]]), *ends)
        for codec, ends in zip((row["codec"], row["anchor"]), rates_of(row["rate"]), strict=True)
    )
    if tested is None or anchor is None:
        return {**keys, "again": nan, "difference": nan, "pchip": nan, "status": NO_CURVE}
    delta = bjontegaard_delta(rate_distortion_curve(*anchor), rate_distortion_curve(*tested))
    pchip = nan if delta.rate_percent is None else delta.rate_percent
    is_cubic = source.interpolation == CUBIC
    again = polynomial_bd_rate(*anchor, *tested) if is_cubic else pchip
    difference = nan if isnan(again) else _difference(row["value"], again)
    more = {"pchip": pchip, "status": delta.rate_status}
    return {**keys, "again": again, "difference": difference, **more}


def _part(
    curves: dict[Any, Any], keys: tuple[str, ...], first: str, last: str
) -> tuple[Floats, Floats] | None:
    """Return bits and values of a curve between two of its rates, or None if it has none."""
    rows = curves.get(keys)
    names = [] if rows is None else list(rows["rate"])
    if rows is None or first not in names or last not in names:
        return None
    chosen = rows.iloc[names.index(first) : names.index(last) + 1]
    return chosen["bpp"].to_numpy(float), chosen["value"].to_numpy(float)


def _difference(printed: float, again: float) -> float:
    """Return a value minus a printed one, after the value is rounded as the printed one is.

    That is to the decimals with which the printed value is written, but to at least one.
    """
    decimals = max(1, len(f"{printed:.6g}".partition(".")[2]))
    return round(round(again, decimals) - printed, decimals) + 0.0


def repeated_curves(source: Source) -> pd.DataFrame:
    """Return the curves that a source gives, number for number, for several clouds.

    Returns
    -------
    pandas.DataFrame
        A row for each repetition: ``dataset``, ``codec``, ``measure``, ``cloud`` and ``same_as``,
        the cloud that has the same curve before it.
    """
    import pandas as pd

    return pd.DataFrame(
        list(_repeated(source.rows)),
        columns=["dataset", "codec", "measure", "cloud", "same_as"],
    )


def _repeated(rows: pd.DataFrame) -> Iterator[dict[str, str]]:
    curves = rows[~rows["measure"].isin(BD_RATES)]
    seen: dict[tuple[Any, ...], str] = {}
    for keys, part in curves.groupby(_CURVE, sort=False):
        dataset, cloud, codec, measure = map(str, keys)
        if len(part) > 1:
            numbers = tuple(zip(part["bpp"], part["value"], strict=True))
            first = seen.setdefault((codec, measure, numbers), cloud)
            if first != cloud:
                curve = {"dataset": dataset, "codec": codec, "measure": measure}
                yield {**curve, "cloud": cloud, "same_as": first}
