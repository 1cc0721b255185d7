"""Check of the time and memory that a codec takes, against what runs plan for it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar

from pointkit.measurement import Cost, Measured, measured
from puckbench.checks.registry import CHECKS, Advice
from puckbench.checks.subject import Subject
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import cost_of
from puckbench.planning.costs import costs_of

T = TypeVar("T")

_FEW, _MANY = 5_000, 20_000
_MILLION = 1_000_000
_FACTOR = 5.0
"""A run names jobs that take so many times the estimate."""
_LEAST_SECONDS = 0.3
"""Shorter times are measured three times, and are no reason for advice."""
_QUADRATIC = 3.0
"""Ratio of times per point that speaks against time in proportion to the points."""


@CHECKS.register("cost", rank=160, advice="work in proportion to the number of points", seconds=60)
def cost(subject: Subject) -> str:
    """Measure clouds of two sizes at the finest rate, and extrapolate to a million points."""
    points, costs = [], []
    for size in (_FEW, _MANY):
        cloud = subject.surface(size)
        points.append(len(cloud))
        coded = _least(subject.codec, partial(subject.encode, cloud, subject.finest))
        stream = coded.result
        back = _least(subject.codec, partial(subject.decode, stream))
        seconds = coded.least_s + back.least_s
        costs.append(Cost(seconds, max(coded.peak_mib, back.peak_mib)))
    seconds, mib = (_extrapolated(points, values) for values in zip(*costs, strict=True))
    line = f"a million points: {seconds:.3g} s and {mib:,.0f} MiB to encode and decode"
    planned = costs_of(subject.codec)
    if mib > _FACTOR * planned.memory_of(_MILLION):
        raise Advice(
            f"{line}, and runs plan {planned.memory_of(_MILLION):,} MB: set "
            f'costs = {{"memory_bytes": {mib * 2**20 / _MILLION:.0f}}}'
        )
    if costs[1].seconds < _LEAST_SECONDS:
        return line
    growth = costs[1].seconds * points[0] / (costs[0].seconds * points[1])
    if growth > _QUADRATIC:
        raise Advice(
            f"{points[1] / points[0]:.0f} times as many points take "
            f"{costs[1].seconds / costs[0].seconds:.0f} times as long: a million points may take "
            "hours: work in proportion to their number"
        )
    if seconds > _FACTOR * planned.seconds_of(_MILLION):
        raise Advice(
            f"{line}, and runs plan {planned.seconds_of(_MILLION):.3g} s: set "
            f'costs = {{"million_s": {seconds:.0f}}}'
        )
    return line


def _least(codec: Codec, call: Callable[[], T]) -> Measured[T]:
    """Measure a call, and quick ones so often that other programs hardly count."""
    whole = partial(cost_of, codec)
    once = measured(call, 1, whole)
    return once if once.seconds > _LEAST_SECONDS else measured(call, 3, whole)


def _extrapolated(points: list[int], values: tuple[float, ...]) -> float:
    """Return the value for a million points, from those of two numbers of points."""
    slope = max(0.0, (values[1] - values[0]) / (points[1] - points[0]))
    return values[1] + slope * (_MILLION - points[1])
