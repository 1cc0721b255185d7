"""Neighbours of the points of a cloud on the rings of a spinning sensor, in the order of coding."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.context_mixing import Ints, Words
from pointkit.compiling import compiled_in_place, inlined

WEST, WEST2, WEST3, BELOW, BELOW_WEST, BELOW_EAST, ABOVE, ABOVE_WEST, THEN, THEN_WEST, THEN_EAST = (
    range(11)
)
COUNT = 11
_FARTHEST = 90
"""A point of another ring is a neighbour only within 1 / 90 of a revolution."""


class Rings(NamedTuple):
    """The points of a cloud, sorted by the ring (laser) that measured them.

    The points of ring g, in the order of coding, are ``order[starts[g] : starts[g + 1]]``; `turned`
    (n,) is how far the sensor had turned at each point since the first one, whose azimuth in the
    direction of turning is `first`.
    """

    order: Words
    starts: Ints
    turned: Ints
    first: int


def rings_of(rings: Words, azimuths: Ints, steps: int, count: int) -> Rings:
    """Sort the points of a cloud by the ring (laser) that measured them.

    Parameters
    ----------
    rings, azimuths
        Number of the ring, and azimuth in steps, of each point, (n,).
    steps, count
        Number of azimuth steps in a revolution, and number of rings.

    Returns
    -------
    Rings
        Order of the points, and how far the sensor had turned at each.
    """
    order = np.argsort(rings.astype(np.uint16), kind="stable").astype(np.int32)
    starts = np.searchsorted(rings[order], np.arange(count + 1)).astype(np.int64)
    half = steps // 2
    changes = np.diff(azimuths[order], prepend=azimuths[:1] * 0)
    firsts = starts[:-1][starts[:-1] < starts[1:]]
    if len(order):
        changes[firsts] = azimuths[order[firsts]] - azimuths[0]
    changes = (changes + half) % steps - half
    sums = np.cumsum(changes)
    sizes = np.diff(starts)
    bases = np.where(starts[:-1] > 0, sums[starts[:-1] - 1], 0) if len(order) else starts[:-1]
    turned = np.empty(len(order), np.int64)
    turned[order] = sums - np.repeat(bases, sizes)
    sign = -1 if np.count_nonzero(changes < 0) > np.count_nonzero(changes > 0) else 1
    return Rings(order, starts, sign * turned, sign * int(azimuths[0]) if len(order) else 0)


def neighbours_of(now: Rings, rings: Words, then: Rings | None, steps: int) -> Words:
    """Return the indices (n, COUNT) of each point's neighbours, or one past the last for none.

    The columns are three points before on the ring (`WEST` ...), points of the rings below and
    above that were coded before, and points of the cloud `then` before.
    """
    count = len(now.starts) - 1
    found = np.empty((len(rings), COUNT), np.int32)
    past = then if then is not None and len(then.starts) == count + 1 else None
    empty = Rings(np.zeros(0, np.int32), np.zeros(count + 1, np.int64), np.zeros(0, np.int64), 0)
    earlier = past or empty
    half = steps // 2
    shift = (now.first - earlier.first + half) % steps - half
    filled, at = now.starts[:-1].copy(), np.zeros((3, count), np.int64)
    at[0, 1:], at[1, :-1] = now.starts[:-2], now.starts[1:-1]
    at[2] = earlier.starts[:-1]
    _find(now, rings, earlier, shift, steps // _FARTHEST, filled, at, found)
    return found


@compiled_in_place
def _find(
    now: Rings, rings: Words, then: Rings, shift: int, far: int, filled: Ints, at: Ints,
    found: Words,
) -> None:  # fmt: skip
    order, n, m = now.order, len(rings), len(then.order)
    for i in range(n):
        ring, angle = rings[i], now.turned[i]
        place = filled[ring]
        for k in range(3):
            found[i, k] = _entry(order, place - 1 - k, now.starts[ring], place, n)
        for side in range(2):
            other = max(min(ring + 2 * side - 1, len(filled) - 1), 0)
            first, end = now.starts[other], filled[other] if other != ring else now.starts[other]
            p = _nearest(now, at[side, ring], end, angle)
            at[side, ring] = p
            p = p if p < end and abs(now.turned[order[p]] - angle) <= far else -1
            column = BELOW if side == 0 else ABOVE
            found[i, column] = _entry(order, p, first, end, n)
            found[i, column + 1] = _entry(order, p - 1, first, end, n) if p >= 0 else n
            if side == 0:
                found[i, BELOW_EAST] = _entry(order, p + 1, first, end, n) if p >= 0 else n
        first, end = then.starts[ring], then.starts[ring + 1]
        p = _nearest(then, at[2, ring], end, angle + shift)
        at[2, ring] = p
        p = p if p < end and abs(then.turned[then.order[p]] - angle - shift) <= far else -1
        found[i, THEN] = _entry(then.order, p, first, end, m)
        found[i, THEN_WEST] = _entry(then.order, p - 1, first, end, m) if p >= 0 else m
        found[i, THEN_EAST] = _entry(then.order, p + 1, first, end, m) if p >= 0 else m
        filled[ring] = place + 1


@inlined
def _entry(order: Words, place: int, first: int, end: int, none: int) -> int:
    return int(order[place]) if first <= place < end else none


@inlined
def _nearest(rings: Rings, place: int, end: int, angle: int) -> int:
    """Return the place from `place` on, before `end`, up to which angles come nearer."""
    if place >= end:
        return place
    order, turned = rings.order, rings.turned
    off = abs(turned[order[place]] - angle)
    while place + 1 < end:
        other = abs(turned[order[place + 1]] - angle)
        if other > off:
            break
        place, off = place + 1, other
    return place
