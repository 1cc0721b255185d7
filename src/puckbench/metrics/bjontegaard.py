"""Bjontegaard deltas: how far apart two rate-distortion curves are, in rate and in quality.

G. Bjontegaard, "Calculation of average PSNR differences between RD-curves" (VCEG-M33, 2001), with
piecewise cubic Hermite interpolation (PCHIP) of the logarithm of the rate, as in the Common Test
Conditions of JVET and of MPEG, in place of the third-order polynomial of 2001.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from puckbench.geometry.cloud import Floats

COMPARED = "compared"
NO_COMMON_RANGE = "no common range"
LITTLE_OVERLAP = "overlap below half"
TOO_FEW_POINTS = "too few points"

LEAST_POINTS = 2
"""Smallest number of points that a curve can be interpolated between."""
LEAST_OVERLAP = 0.5
"""Smallest part of the shorter curve's range that both curves must have."""
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Curve:
    """Rate-distortion points of a codec on one cloud, both arrays strictly rising.

    Parameters
    ----------
    log_rate
        Natural logarithm of the rate, (k,).
    quality
        In dB, (k,).
    dropped
        Number of points left out because a cheaper one is at least as good.
    """

    log_rate: Floats
    quality: Floats
    dropped: int


@dataclass(frozen=True)
class Delta:
    """Bjontegaard deltas of a curve against an anchor's.

    Parameters
    ----------
    log_ratio
        Mean of ln(rate / anchor's rate) at equal quality, over the qualities that both reach; None
        where these are less than `LEAST_OVERLAP` of the shorter curve's.
    quality_db
        Mean difference of quality at equal rate, over the rates that both have; None likewise.
    rate_status, quality_status
        `COMPARED`, or why there is no value.
    shared
        Length of the common range of quality over that of the shorter curve.
    """

    log_ratio: float | None
    quality_db: float | None
    rate_status: str
    quality_status: str
    shared: float = 0.0

    @property
    def rate_percent(self) -> float | None:
        """The BD-rate: negative where the codec needs fewer bits than the anchor."""
        return None if self.log_ratio is None else 100 * float(np.expm1(self.log_ratio))


def curve(rates: Floats, qualities: Floats) -> Curve:
    """The rate-distortion curve through measured points.

    A point that is no better than a cheaper one is left out, since it would make the curve
    ambiguous; so are missing values.

    Parameters
    ----------
    rates
        Positive, (k,).
    qualities
        In dB, (k,).
    """
    known = np.isfinite(rates) & np.isfinite(qualities)
    rates, qualities = rates[known], qualities[known]
    order = np.lexsort((-qualities, rates))
    rates, qualities = rates[order], qualities[order]
    best = np.maximum.accumulate(np.concatenate([[-np.inf], qualities]))[:-1]
    kept = qualities > best
    return Curve(np.log(rates[kept]), qualities[kept], int(np.count_nonzero(~kept)))


def delta(anchor: Curve, tested: Curve) -> Delta:
    """Bjontegaard deltas of `tested` against `anchor`, without extrapolation."""
    if min(len(anchor.quality), len(tested.quality)) < LEAST_POINTS:
        return Delta(None, None, TOO_FEW_POINTS, TOO_FEW_POINTS)
    ratio, rate_status, shared = _difference(
        (anchor.quality, anchor.log_rate), (tested.quality, tested.log_rate)
    )
    gain, quality_status, _ = _difference(
        (anchor.log_rate, anchor.quality), (tested.log_rate, tested.quality)
    )
    return Delta(ratio, gain, rate_status, quality_status, shared)


def _difference(
    anchor: tuple[Floats, Floats], tested: tuple[Floats, Floats]
) -> tuple[float | None, str, float]:
    """Mean of `tested` less `anchor`, curves of x and y, over common x; its status; the overlap."""
    low, high = _common(anchor[0], tested[0])
    shared = max(0.0, high - low) / float(min(np.ptp(anchor[0]), np.ptp(tested[0])))
    if shared == 0:
        return None, NO_COMMON_RANGE, shared
    if shared < LEAST_OVERLAP * (1 - _ROUNDING):
        return None, LITTLE_OVERLAP, shared
    return _mean_difference(anchor, tested, low, high), COMPARED, shared


def _common(a: Floats, b: Floats) -> tuple[float, float]:
    return float(max(a[0], b[0])), float(min(a[-1], b[-1]))


def _mean_difference(
    anchor: tuple[Floats, Floats], tested: tuple[Floats, Floats], low: float, high: float
) -> float:
    """Mean of `tested` less `anchor`, curves of x and y, over x from `low` to `high`."""
    from scipy.interpolate import PchipInterpolator

    areas = [float(PchipInterpolator(x, y).integrate(low, high)) for x, y in (anchor, tested)]
    return (areas[1] - areas[0]) / (high - low)
