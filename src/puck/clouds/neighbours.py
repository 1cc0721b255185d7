"""Neighbours of the points of a cloud on the rings of a spinning sensor, in the order of coding."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.context_mixing import Ints, Words
from pointkit.compiling import compiled_in_place

WEST, WEST2, WEST3, BELOW, BELOW_WEST, BELOW_EAST, ABOVE, ABOVE_WEST, THEN, THEN_WEST, THEN_EAST = (
    range(11)
)
COUNT = 11
_FARTHEST = 90
"""A point of another ring is a neighbour only within 1 / 90 of a revolution."""


class Rings(NamedTuple):
    """The points of a cloud by rings.

    The points of ring g, in the order of coding, are ``order[starts[g] : starts[g + 1]]``; `turned`
    (n,) is how far the sensor had turned at each point since the first one, whose azimuth in the
    direction of turning is `first`.
    """

    order: Words
    starts: Ints
    turned: Ints
    first: int


def rings_of(rings: Words, azimuths: Ints, steps: int, count: int) -> Rings:
    """Return the points of a cloud by rings.

    Parameters
    ----------
    rings, azimuths
        Ring and azimuth of each point, (n,).
    steps, count
        Numbers of azimuth steps in a revolution, and of rings.
    """
    order = np.argsort(rings, kind="stable").astype(np.int32)
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
    order, starts, turned = now.order, now.starts, now.turned
    n, m, count = len(rings), len(then.order), len(starts) - 1
    for i in range(n):
        ring, angle = rings[i], turned[i]
        place, first = filled[ring], starts[ring]
        for k in range(3):
            found[i, k] = order[place - 1 - k] if place - 1 - k >= first else n
        for k in range(3, 8):
            found[i, k] = n
        for side in range(2):
            other = ring - 1 if side == 0 else ring + 1
            if other < 0 or other >= count or filled[other] == starts[other]:
                continue
            p, end = at[side, ring], filled[other]
            while p + 1 < end and abs(turned[order[p + 1]] - angle) <= abs(
                turned[order[p]] - angle
            ):
                p += 1
            at[side, ring] = p
            if abs(turned[order[p]] - angle) > far:
                continue
            column = 3 if side == 0 else 6
            found[i, column] = order[p]
            found[i, column + 1] = order[p - 1] if p > starts[other] else n
            if side == 0:
                found[i, 5] = order[p + 1] if p + 1 < end else n
        for k in range(8, 11):
            found[i, k] = m
        if then.starts[ring] < then.starts[ring + 1]:
            p, end, wanted = at[2, ring], then.starts[ring + 1], angle + shift
            while p + 1 < end and abs(then.turned[then.order[p + 1]] - wanted) <= abs(
                then.turned[then.order[p]] - wanted
            ):
                p += 1
            at[2, ring] = p
            if abs(then.turned[then.order[p]] - wanted) <= far:
                found[i, 8] = then.order[p]
                found[i, 9] = then.order[p - 1] if p > then.starts[ring] else m
                found[i, 10] = then.order[p + 1] if p + 1 < end else m
        filled[ring] = place + 1
