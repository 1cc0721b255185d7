"""Bjontegaard deltas between rate-distortion curves (G. Bjontegaard, VCEG-M33, 2001).

As in the common test conditions of JVET and MPEG, a piecewise cubic Hermite polynomial (PCHIP)
interpolates the log rate, without extrapolation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from puckbench.geometry.cloud import Floats

COMPARED = "compared"
NO_COMMON_RANGE = "no common range"
LITTLE_OVERLAP = "overlap below half"
TOO_FEW_POINTS = "too few points"

MIN_POINTS = 2
"""Fewest points of a curve."""
MIN_OVERLAP = 0.5
"""Smallest common range of two curves, as a share of the shorter curve's range."""
_ROUNDING = 1e-12


@dataclass(frozen=True)
class RateDistortionCurve:
    """A rate-distortion curve: points (k,), strictly increasing in ln(rate) and quality (dB).

    `dropped` counts excluded dominated points (see `rate_distortion_curve`).
    """

    log_rate: Floats
    quality: Floats
    dropped: int


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
        Common range of quality, as a fraction of the shorter range.
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

    A dominated point has at least the bits of another, and at most its quality.
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
    ratio, rate_status, overlap = _difference(
        (anchor.quality, anchor.log_rate), (tested.quality, tested.log_rate)
    )
    gain, quality_status, _ = _difference(
        (anchor.log_rate, anchor.quality), (tested.log_rate, tested.quality)
    )
    return BjontegaardDelta(ratio, gain, rate_status, quality_status, overlap)


def _difference(
    anchor: tuple[Floats, Floats], tested: tuple[Floats, Floats]
) -> tuple[float | None, str, float]:
    low, high = _common(anchor[0], tested[0])
    overlap = max(0.0, high - low) / float(min(np.ptp(anchor[0]), np.ptp(tested[0])))
    if overlap == 0:
        return None, NO_COMMON_RANGE, overlap
    if overlap < MIN_OVERLAP * (1 - _ROUNDING):
        return None, LITTLE_OVERLAP, overlap
    return _mean_difference(anchor, tested, low, high), COMPARED, overlap


def _common(a: Floats, b: Floats) -> tuple[float, float]:
    return float(max(a[0], b[0])), float(min(a[-1], b[-1]))


def _mean_difference(
    anchor: tuple[Floats, Floats], tested: tuple[Floats, Floats], low: float, high: float
) -> float:
    from scipy.interpolate import PchipInterpolator

    areas = [float(PchipInterpolator(x, y).integrate(low, high)) for x, y in (anchor, tested)]
    return (areas[1] - areas[0]) / (high - low)
