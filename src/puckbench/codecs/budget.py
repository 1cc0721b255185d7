"""The rate at which a codec's streams meet a budget of bits.

A codec whose rates have a step as their only parameter gets the step at which a stream takes 98 to
100 % of the budget. It is found by the secant method, and each of its probes is an encoding. The
search is in the logarithm of the step, and in the height log(2^(b/m) - 1) of the number b of bits
per point, where m is the number of quantised coordinates: three of a point, one of a return. This
height is nearly linear: where steps are fine, each halving adds a bit to a coordinate, and where
they are coarse, it multiplies the bits.

Any other codec gets the largest of its rates that the budget allows.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud, bounds
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import skip_reason
from puckbench.codecs.rates import (
    Budget,
    Parameters,
    is_length,
    offered_rates,
    step_range,
    takes_any_scale,
)

TOLERANCE = 0.02
"""Largest share of a budget that a stream leaves unused if the step is free."""
MOST_PROBES = 8
"""Largest number of encodings of a search."""
_LEAST_SLOPE, _MOST_SLOPE = -3.0, -0.3
"""Limits of the slope of the height over the logarithm of the step, beyond the probes."""
_CLOSE = 1e-4
"""Difference of logarithms below which two steps count as equal."""
_LAST_OPEN = 5
"""Number of probes after which the search goes to the end of the range, if all are on one side."""

Encode = Callable[[Codec, str], int]
"""Function that encodes at a rate of a codec, and returns the number of bytes with all wrappers."""


class Chosen(NamedTuple):
    """The rate that meets a budget.

    Parameters
    ----------
    codec
        The codec, which has the rate: a copy if the step is none of its named rates.
    rate
        Name of the rate.
    probes
        Number of encodings of the search.
    remark
        One line if the stream leaves more than `TOLERANCE` of the budget unused, or if the codec
        has fixed rates; otherwise None.
    """

    codec: Codec
    rate: str
    probes: int
    remark: str | None


def rate_within(
    codec: Codec,
    clouds: Sequence[PointCloud],
    budget: Budget,
    encode: Encode,
    seconds: float | None = None,
) -> Chosen:
    """Find the rate of a codec at which the streams of clouds meet a budget.

    The streams never take more than the budget. They take at least 98 % of it if the step is free,
    unless the codec's finest step takes less, or bits leap from one step to the next.

    Parameters
    ----------
    codec
        The codec, ready to code.
    clouds
        One cloud, or turns that are coded at one rate. Coordinates of an unknown frame are metres
        if the codec has rates for clouds in metres.
    budget
        The most bits that the streams of all clouds may take together.
    encode
        Function that encodes all clouds at a rate of a codec, and returns the number of bytes. It
        is called at most once for each rate, at most `MOST_PROBES` times for a free step, and once
        more if the budget is out of reach.
    seconds
        Time in which the sensor recorded the clouds, s. Budgets in megabits per second need it.

    Raises
    ------
    InputError
        The budget is less than the codec's coarsest rate takes, the codec skips the clouds at all
        rates, or the budget is one of bits per second and `seconds` is None.
    """
    extent = max(float(np.ptp(bounds(cloud.xyz), axis=0).max()) for cloud in clouds)
    kind, table = _codable(codec, clouds, extent)
    points = sum(map(len, clouds))
    probes = _Probes(codec, encode, budget, budget.bits(points, seconds) / budget.amount)
    scale = _free_scale(codec, table, clouds[0], kind, extent)
    if scale is None:
        names = list(table)
        _bisect(probes, table, names)
        ends = _Rate(names[0], table[names[0]]), _Rate(names[-1], table[names[-1]])
    else:
        _search(probes, scale, points)
        ends = scale.rate(scale.coarsest), scale.rate(scale.finest)
    best = probes.best()
    if best is None:
        raise InputError(_out_of_reach(probes, *ends))
    remark = _remark(probes, best, ends[1].name, scale)
    return Chosen(probes.rated[best], best, len(probes.taken), remark)


class _Rate(NamedTuple):
    name: str
    parameters: Parameters


@dataclass
class _Probes:
    """The encodings of a search, in the unit of the budget by name of the rate."""

    codec: Codec
    encode: Encode
    budget: Budget
    bits_per_unit: float
    taken: dict[str, float] = field(default_factory=dict)
    rated: dict[str, Codec] = field(default_factory=dict)

    def amount(self, rate: _Rate) -> float:
        """Return what the streams take at a rate, in the unit of the budget."""
        if rate.name not in self.taken:
            codec = _with_rate(self.codec, rate)
            self.rated[rate.name] = codec
            self.taken[rate.name] = 8 * self.encode(codec, rate.name) / self.bits_per_unit
        return self.taken[rate.name]

    def best(self) -> str | None:
        """Return the rate that takes most within the budget, or None if all take more."""
        within = [name for name, amount in self.taken.items() if amount <= self.budget.amount]
        return max(within, key=self.taken.__getitem__, default=None)

    def is_met(self, amount: float) -> bool:
        return (1 - TOLERANCE) * self.budget.amount <= amount <= self.budget.amount

    def told(self, name: str) -> str:
        return f"{self.taken[name]:.4g} {self.budget.words}"


class _Steps(NamedTuple):
    """The steps that a search may try.

    Parameters
    ----------
    finest, coarsest, start
        Ends of the range, and first step: in m, or in steps of a scaled cloud's grid.
    unit
        Length of which steps are multiples; None for any step.
    is_metric
        Whether steps are lengths.
    """

    finest: float
    coarsest: float
    start: float
    unit: float | None
    is_metric: bool

    @property
    def coordinates(self) -> int:
        """Number of quantised coordinates of a point: the steps of ranges are multiples."""
        return 3 if self.unit is None else 1

    def rate(self, step: float) -> _Rate:
        if self.is_metric:
            return _length(step)
        scale = float(f"{1 / step:.6g}")
        return _Rate(f"scale_{scale:.6g}", {"scale": scale})

    def next_to(self, step: float, fine: float | None, coarse: float | None) -> float | None:
        """Return the allowed step that is nearest to `step` between two others; None without any.

        `fine` and `coarse` are the nearest steps that were tried already, if there are any.
        """
        if self.unit is not None:
            low = 1 + (self._count(self.finest) - 1 if fine is None else self._count(fine))
            high = (1 + self._count(self.coarsest) if coarse is None else self._count(coarse)) - 1
            count = min(max(self._count(step), low), high)
            return count * self.unit if low <= high else None
        least = self.finest if fine is None else fine * (1 + _CLOSE / 2)
        most = self.coarsest if coarse is None else coarse / (1 + _CLOSE / 2)
        return min(max(step, least), most) if least <= most else None

    def _count(self, step: float) -> int:
        return max(1, round(step / (self.unit or 1.0)))


class _End:
    """One end of the interval that encloses the step: its logarithm, and how far it is too high."""

    def __init__(self, step: float, excess: float) -> None:
        self.step, self.x, self.excess = step, math.log(step), excess


def _search(probes: _Probes, steps: _Steps, points: int) -> None:
    """Probe steps by the Illinois method until one meets the budget, or none is left to try."""

    def height(amount: float) -> float:
        bits = amount * probes.bits_per_unit / points * math.log(2) / steps.coordinates
        return bits + math.log(-math.expm1(-bits))

    goal = height((1 - TOLERANCE / 2) * probes.budget.amount)
    fine: _End | None = None
    coarse: _End | None = None
    before: _End | None = None
    step: float | None = steps.next_to(steps.start, None, None)
    for number in range(1, MOST_PROBES + 1):
        if step is None or probes.is_met(amount := probes.amount(steps.rate(step))):
            return
        here = _End(step, height(amount) - goal)
        if amount > probes.budget.amount:
            if before is not None and before is fine and coarse is not None:
                coarse.excess /= 2
            fine = here
        else:
            if before is not None and before is coarse and fine is not None:
                fine.excess /= 2
            coarse = here
        if fine is not None and coarse is not None:
            x = (fine.x * coarse.excess - coarse.x * fine.excess) / (coarse.excess - fine.excess)
        elif number >= _LAST_OPEN:
            x = math.log(steps.coarsest if coarse is None else steps.finest)
        else:
            x = here.x - here.excess / _slope(before, here)
        tried = (None if fine is None else fine.step, None if coarse is None else coarse.step)
        step, before = steps.next_to(math.exp(min(x, 100.0)), *tried), here


def _slope(before: _End | None, here: _End) -> float:
    """Return the slope of the height at the last probes, within limits; -1 after the first."""
    if before is None:
        return -1.0
    slope = (here.excess - before.excess) / (here.x - before.x)
    return min(max(slope, _LEAST_SLOPE), _MOST_SLOPE)


def _bisect(probes: _Probes, table: Mapping[str, Parameters], names: Sequence[str]) -> None:
    """Probe rates, the smallest bitrate first, until the largest within the budget is known."""
    low, high = -1, len(names)
    while high - low > 1:
        middle = (low + high) // 2
        rate = _Rate(names[middle], table[names[middle]])
        if probes.amount(rate) <= probes.budget.amount:
            low = middle
        else:
            high = middle


def _codable(
    codec: Codec, clouds: Sequence[PointCloud], extent: float
) -> tuple[CloudKind, Mapping[str, Parameters]]:
    """Return the kind of clouds, and the rates at which the codec encodes them.

    `extent` is the largest side of their bounding boxes. Raises InputError with the reason if there
    are none.
    """
    frame = clouds[0].frame
    table = offered_rates(codec, frame)
    if frame is None and (metric := offered_rates(codec, "metric")):
        table = metric
    reasons, coded = [], {}
    kind = CloudKind.of(clouds[0])
    for rate, parameters in (table or codec.rates).items():
        if kind.frame is None and is_length(codec, rate):
            kind = kind._replace(frame="metric")
        if kind.frame == "metric":
            kind = kind._replace(extent_m=extent)
        if reason := skip_reason(codec, kind, rate):
            reasons.append(reason)
        else:
            coded[rate] = parameters
    if not coded:
        raise InputError(f"codec {codec.name}: {reasons[0]}")
    return kind, coded


def _free_scale(
    codec: Codec,
    table: Mapping[str, Parameters],
    cloud: PointCloud,
    kind: CloudKind,
    extent: float,
) -> _Steps | None:
    """Return the steps that a codec may take for clouds, or None if its rates are fixed."""
    if all({*parameters} == {"step_m"} for parameters in table.values()):
        finest, coarsest, unit = step_range(codec, cloud)
        finest = _finest_coded(codec, kind, finest, coarsest)
        named = [float(parameters["step_m"]) for parameters in table.values()]
        if unit is None:
            coarsest = min(coarsest, max(extent, finest, *named))
        return _Steps(finest, coarsest, math.sqrt(max(named) * min(named)), unit, True)
    if takes_any_scale(codec) and all({*parameters} == {"scale"} for parameters in table.values()):
        named = [1 / float(parameters["scale"]) for parameters in table.values()]
        widest = max(extent / (getattr(codec.options, "unit", None) or 1.0), *named)
        return _Steps(min(named), widest, math.sqrt(max(named) * min(named)), None, False)
    return None


def _finest_coded(codec: Codec, kind: CloudKind, finest: float, coarsest: float) -> float:
    """Return the finest step at which a codec does not skip clouds, nearly."""

    def is_coded(step: float) -> bool:
        rate = _length(step)
        return skip_reason(_with_rate(codec, rate), kind, rate.name) is None

    if is_coded(finest):
        return finest
    while coarsest > 1.01 * finest:
        middle = math.sqrt(finest * coarsest)
        if is_coded(middle):
            coarsest = middle
        else:
            finest = middle
    return coarsest


def _length(step_m: float) -> _Rate:
    """Return the rate of a step in m, rounded as rates named by a length are."""
    name = f"{1000 * step_m:.6g}"
    return _Rate(f"{name}mm", {"step_m": float(name) / 1000})


def _with_rate(codec: Codec, rate: _Rate) -> Codec:
    """Return the codec if it has a rate, or else a copy that has it and shares all else."""
    if rate.name in codec.rates:
        return codec
    rated = copy.copy(codec)
    rated.rates = {**codec.rates, rate.name: rate.parameters}
    return rated


def _out_of_reach(probes: _Probes, coarsest: _Rate, finest: _Rate) -> str:
    probes.amount(coarsest)
    probes.amount(finest)
    least, most = (f"{probes.told(rate.name)} ({rate.name})" for rate in (coarsest, finest))
    fault = f"{probes.budget.name} is out of reach, which is from {least} to {most}"
    return f"codec {probes.codec.name}: {fault}"


def _remark(probes: _Probes, best: str, finest: str, steps: _Steps | None) -> str | None:
    """Return one line about a rate that leaves a part of the budget, or is fixed; else None."""
    name, told = probes.codec.name, probes.told(best)
    within = f"the most within {probes.budget.name}"
    if steps is not None and probes.is_met(probes.taken[best]):
        return None
    if best == finest:
        return f"codec {name}: its finest rate, {best}, takes {told} of {probes.budget.name}"
    if steps is None:
        return f"codec {name} has fixed rates: {best} takes {told}, {within}"
    if steps.unit is not None:
        multiples = f"steps are multiples of {1000 * steps.unit:g}mm"
        return f"codec {name}: {multiples}: {best} takes {told}, {within}"
    return f"codec {name}: {best} takes {told}, {within} of {len(probes.taken)} encodings"
