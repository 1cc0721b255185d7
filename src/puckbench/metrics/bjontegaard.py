"""Bjontegaard deltas between rate-distortion curves (G. Bjontegaard, VCEG-M33, 2001).

As in the common test conditions of JVET and MPEG, a piecewise cubic Hermite polynomial (PCHIP)
interpolates the log rate, without extrapolation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from puckbench.geometry.cloud import Floats

COMPARED = "compared"
NO_COMMON_RANGE = "no common range"
LITTLE_OVERLAP = "overlap below half"
TOO_FEW_POINTS = "too few points"

MIN_POINTS = 2
MIN_OVERLAP = 0.5
"""Minimum common range of two curves, as a fraction of the shorter curve's range."""
_ROUNDING = 1e-12


@dataclass(frozen=True)
class RateDistortionCurve:
    """A rate-distortion curve: points (k,), strictly increasing in ln(rate) and quality (dB).

    `dropped` is the number of dominated points that `rate_distortion_curve` removed.
    """

    log_rate: Floats
    quality: Floats
    dropped: int

    @cached_property
    def rate_interpolant(self) -> Any:
        return _interpolant(self.quality, self.log_rate)

    @cached_property
    def quality_interpolant(self) -> Any:
        return _interpolant(self.log_rate, self.quality)


def _interpolant(x: Floats, y: Floats) -> Any:
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(x, y)


@dataclass(frozen=True)
class BjontegaardDelta:
    """Bjontegaard deltas of a curve against an anchor curve.

    Parameters
    ----------
    log_ratio
        Mean of ln(rate / anchor rate) at equal quality.
    quality_db
        Mean difference in quality at equal rate.
    overlap
        Common quality range of both curves, as a fraction of the shorter range.
    """

    log_ratio: float | None
    quality_db: float | None
    rate_status: str
    quality_status: str
    overlap: float = 0.0

    @property
    def rate_percent(self) -> float | None:
        """BD-rate in percent: negative if the tested codec needs fewer bits than the anchor."""
        return None if self.log_ratio is None else 100 * float(np.expm1(self.log_ratio))


def rate_distortion_curve(rates: Floats, qualities: Floats) -> RateDistortionCurve:
    """Return the curve through points (k,), without missing values and dominated points.

    A point is dominated if another point has no higher rate and no lower quality.
    """
    is_finite = np.isfinite(rates) & np.isfinite(qualities)
    rates, qualities = rates[is_finite], qualities[is_finite]
    order = np.lexsort((-qualities, rates))
    rates, qualities = rates[order], qualities[order]
    best_so_far = np.maximum.accumulate(np.concatenate([[-np.inf], qualities]))[:-1]
    is_better = qualities > best_so_far
    return RateDistortionCurve(
        np.log(rates[is_better]), qualities[is_better], int(np.count_nonzero(~is_better))
    )


def bjontegaard_delta(anchor: RateDistortionCurve, tested: RateDistortionCurve) -> BjontegaardDelta:
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
