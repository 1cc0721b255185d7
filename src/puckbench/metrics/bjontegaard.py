"""Bjontegaard deltas between rate-distortion curves (G. Bjontegaard, VCEG-M33, 2001).

As in the common test conditions of JVET and MPEG, a piecewise cubic Hermite polynomial (PCHIP)
interpolates the log rate, without extrapolation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

COMPARED = "compared"
NO_COMMON_RANGE = "no common range"
LITTLE_OVERLAP = "overlap below half"
TOO_FEW_POINTS = "too few points"

MIN_POINTS = 4
"""A curve needs at least this many points, as in the common test conditions."""
MIN_OVERLAP = 0.5
"""The common range of two curves must be at least this fraction of the shorter curve's range."""
_ROUNDING = 1e-12


@dataclass(frozen=True)
class RateDistortionCurve:
    """A rate-distortion curve holds the points of one codec on one cloud, ready for interpolation.

    `rate_distortion_curve` makes it from measured rates and qualities.

    Parameters
    ----------
    log_rate
        Natural logarithms of the rates (k,), strictly increasing.
    quality
        Qualities (k,) in dB, strictly increasing.
    pooled
        Number of points that were removed by pooling (see `rate_distortion_curve`).
    """

    log_rate: Floats
    quality: Floats
    pooled: int

    @cached_property
    def rate_interpolant(self) -> Any:
        """The polynomial that gives ln(rate) at a quality."""
        return _interpolant(self.quality, self.log_rate)

    @cached_property
    def quality_interpolant(self) -> Any:
        """The polynomial that gives the quality at an ln(rate)."""
        return _interpolant(self.log_rate, self.quality)


def _interpolant(x: Floats, y: Floats) -> Any:
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(x, y)


@dataclass(frozen=True)
class BjontegaardDelta:
    """The result of `bjontegaard_delta` tells how a tested curve differs from an anchor curve.

    Parameters
    ----------
    log_ratio
        Mean of ln(rate / anchor rate) at equal quality; None if it cannot be computed.
    quality_db
        Mean difference in quality (tested minus anchor) at equal rate, in dB; None if it cannot be
        computed.
    rate_status, quality_status
        `COMPARED`, or the reason why `log_ratio` or `quality_db` is None.
    overlap
        Quality range that both curves share, as a fraction of the shorter range.
    """

    log_ratio: float | None
    quality_db: float | None
    rate_status: str
    quality_status: str
    overlap: float = 0.0

    @property
    def rate_percent(self) -> float | None:
        """The BD-rate in percent, or None if `log_ratio` is None.

        It is negative if the tested codec needs fewer bits than the anchor.
        """
        return None if self.log_ratio is None else 100 * float(np.expm1(self.log_ratio))


def rate_distortion_curve(rates: Floats, qualities: Floats) -> RateDistortionCurve:
    """Build a rate-distortion curve from the measured points of a codec.

    A point at which more bits give no better quality is pooled with the point before it: both are
    replaced by the mean of their qualities and the mean of their ln(rate) (pool adjacent
    violators). In this way the bad rates of a codec also count.

    Parameters
    ----------
    rates
        Rates (k,) above 0, in any unit and order.
    qualities
        Qualities (k,) in dB. Points with an infinite or missing value are left out.

    Returns
    -------
    RateDistortionCurve
        The curve, which has no points if no point is finite.
    """
    is_finite = np.isfinite(rates) & np.isfinite(qualities)
    log_rates, qualities = np.log(rates[is_finite]), qualities[is_finite]
    pools: list[NDArray[np.float64]] = []
    for place in np.lexsort((qualities, log_rates)):
        pools.append(np.array([log_rates[place], qualities[place], 1.0]))
        while len(pools) > 1 and not _increases(pools[-2], pools[-1]):
            pools[-2:] = [pools[-2] + pools[-1]]
    means = np.array([pool[:2] / pool[2] for pool in pools]).reshape(-1, 2)
    return RateDistortionCurve(means[:, 0], means[:, 1], len(qualities) - len(pools))


def _increases(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    return bool(np.all(before[:2] / before[2] < after[:2] / after[2]))


def bjontegaard_delta(anchor: RateDistortionCurve, tested: RateDistortionCurve) -> BjontegaardDelta:
    """Compare two rate-distortion curves by their Bjontegaard deltas.

    Both deltas are None if a curve has fewer than `MIN_POINTS` points. A single delta is None if
    the curves have too little of its range in common (see `MIN_OVERLAP`).

    Parameters
    ----------
    anchor
        Curve of the codec to compare with.
    tested
        Curve of the codec under test.

    Returns
    -------
    BjontegaardDelta
        The mean differences of the tested curve to the anchor, and the reasons for missing ones.
    """
    if min(len(anchor.quality), len(tested.quality)) < MIN_POINTS:
        return BjontegaardDelta(None, None, TOO_FEW_POINTS, TOO_FEW_POINTS)
    ratio, rate_status, overlap = _difference(anchor, tested, "quality", "rate_interpolant")
    gain, quality_status, _ = _difference(anchor, tested, "log_rate", "quality_interpolant")
    return BjontegaardDelta(ratio, gain, rate_status, quality_status, overlap)


def _difference(
    anchor: RateDistortionCurve, tested: RateDistortionCurve, axis: str, interpolant: str
) -> tuple[float | None, str, float]:
    a, b = getattr(anchor, axis), getattr(tested, axis)
    low, high = float(max(a[0], b[0])), float(min(a[-1], b[-1]))
    overlap = max(0.0, high - low) / float(min(np.ptp(a), np.ptp(b)))
    if overlap == 0:
        return None, NO_COMMON_RANGE, overlap
    if overlap < MIN_OVERLAP * (1 - _ROUNDING):
        return None, LITTLE_OVERLAP, overlap
    areas = [float(getattr(curve, interpolant).integrate(low, high)) for curve in (anchor, tested)]
    return (areas[1] - areas[0]) / (high - low), COMPARED, overlap
