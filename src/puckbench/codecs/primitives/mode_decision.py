"""Ways to code a cloud: each is tried, judged by what it costs and by how near it comes.

Surfaces are coded along the cloud's axes and along its walls', with round surfaces and without.
Voxels get the same number of bytes; the better is kept. Better is judged against the smoothed
surface, for a decode that is nearer to the noisy points than their noise is reproduces noise. But a
surface has also to be as near to the points themselves as the voxels are when they stay where G-PCC
has them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from puckbench.codecs.primitives import voxels
from puckbench.codecs.primitives.decision_error import Errors, Judge
from puckbench.codecs.primitives.decoder import Patches, decode_stream, decoded_of
from puckbench.codecs.primitives.encoder import (
    Cloud,
    Way,
    encode_surface,
    prepared,
    round_surfaces,
)
from puckbench.codecs.primitives.grid_alignment import first_ways, other_margins, shifted
from puckbench.codecs.primitives.settings import Settings
from puckbench.core.environment import allowed_threads
from puckbench.core.threads import in_threads
from puckbench.geometry.cloud import Floats


def encode(points: Floats, settings: Settings) -> bytes:
    """Code points (n, 3) as surfaces or as voxels."""
    most = int(settings.bpp * len(points) / 8)
    if float(np.ptp(points, axis=0).max()) == 0:
        return voxels.encode_at(points, 1.0)
    if settings.leaf == 0:
        return voxels.encode_within(points, most, settings.voxel)
    cloud = prepared(points, settings)
    judge = Judge.of(cloud.points, *cloud.surface[:3])
    best = _best_surface(cloud, judge)
    if best.stream is None:
        return voxels.encode_within(points, most)
    return _surface_or_voxels(points, cloud, judge, best, most)


_DEARER = (1.0, 2.0, 4.0)
"""Prices of bits, times the rate's, at which a surface is held against voxels.

The more bits, the nearer voxels come to noise and to scattered points, and surfaces do not. A
surface of fewer bits may still be ahead of voxels of as few.
"""


def _surface_or_voxels(points: Floats, cloud: Cloud, judge: Judge, best: _Try, most: int) -> bytes:
    """The finest surface that is ahead of voxels of as many bytes in all; else voxels.

    Where the cheapest surface is ahead of them in one respect and behind in another, the product
    of the errors decides.
    """
    rivals: list[bytes] = []
    cheapest, match = b"", None
    for dearer in _DEARER:
        settings = replace(cloud.settings, price=dearer * cloud.settings.price)
        cheaper = cloud._replace(settings=settings)
        stream = best.stream if dearer == 1 else _stream_of(cheaper, best.way)
        fits = stream is not None and len(stream) <= most
        rivals.append(voxels.encode_within(points, len(stream) if stream and fits else most))
        if stream and fits:
            cheapest, match = stream, _Match.of(cloud, judge, stream, rivals[-1])
            if match.wins():
                return stream
    return cheapest if match is not None and match.wins_in_sum() else rivals[0]


_MOST_REFUSED = 3
"""Round surfaces in a row that cost more than they save, after which no more are tried."""


_SAVING = 0.98
"""Cost, times another's, below which the grid is moved: less may be chance."""


def _stream_of(cloud: Cloud, way: Way) -> bytes | None:
    coded = encode_surface(cloud, way)
    return coded and coded.stream


class _Try(NamedTuple):
    """A way to code a surface, what it costs (error + price x bits), and the stream."""

    cost: float
    way: Way
    stream: bytes | None


def _best_surface(cloud: Cloud, judge: Judge) -> _Try:
    """The surface that costs least."""
    best = _best_grid(cloud, judge)
    waiting, refused = list(round_surfaces(cloud)), 0
    while waiting and refused < _MOST_REFUSED:
        # Several at once: those after one that is taken are tried again, beside it.
        several = waiting[: min(allowed_threads(), _MOST_REFUSED - refused)]
        ways = [best.way._replace(rounds=(*best.way.rounds, each)) for each in several]
        tries = in_threads(partial(_tried, cloud, judge), ways)
        for found in tries:
            waiting.pop(0)
            if found.cost < best.cost:
                best, refused = found, 0
                break
            refused += 1
    return best


def _best_grid(cloud: Cloud, judge: Judge) -> _Try:
    """The best axes, then the best place of the grid along them."""
    best = _best_of(cloud, judge, first_ways(cloud), None)
    best = _best_of(cloud, judge, other_margins(cloud, best.way), best)
    for axis in range(3):
        best = _best_of(cloud, judge, shifted(cloud, best.way, axis), best)
    return best


def _best_of(cloud: Cloud, judge: Judge, ways: Iterable[Way], known: _Try | None) -> _Try:
    """The cheapest way of some; one that is known unless another saves enough."""
    tries = in_threads(partial(_tried, cloud, judge), ways)
    best = min([*tries, *([known] if known else [])], key=lambda found: found.cost)
    return best if known is None or best.cost < _SAVING * known.cost else known


def _tried(cloud: Cloud, judge: Judge, way: Way) -> _Try:
    coded = encode_surface(cloud, way)
    if coded is None:
        return _Try(np.inf, way, None)
    error = judge.to_surface(cloud.in_units(_thinly_decoded(coded.patches)))
    rate = 8 * len(coded.stream) / len(cloud.points)
    return _Try(error + cloud.settings.price * rate, way, coded.stream)


def _thinly_decoded(patches: Patches) -> Floats:
    """Points of surfaces, fewer than the decoder makes."""
    header = patches.header
    thin = header._replace(fineness=max(header.fineness // 3, 1))
    return decoded_of(patches._replace(header=thin)).xyz


class _Match(NamedTuple):
    """Errors of a surface, of voxels of as many bytes, and of these where G-PCC has them."""

    own: Errors
    other: Errors
    plain: Errors

    @classmethod
    def of(cls, cloud: Cloud, judge: Judge, surface: bytes, rival: bytes) -> _Match:
        """Decode both and measure them."""
        decoded = (decode_stream(surface), decode_stream(rival), voxels.unmoved(rival))
        return cls(*(judge.errors(cloud.in_units(xyz)) for xyz in decoded))

    def wins(self) -> bool:
        """Whether the surface is the nearer one to the smoothed samples and to the points."""
        nearer = self.own.surface <= self.other.surface and self.own.plane <= self.plain.plane
        return nearer and self.own.point <= _FARTHER * self.plain.point

    def wins_in_sum(self) -> bool:
        """Whether what the surface gains in some errors is more than it loses in the others."""
        product = np.prod(self.own) <= np.prod(self.other)
        return bool(product and self.own.point <= _FARTHEST * self.plain.point)


_FARTHER, _FARTHEST = 1.05, 1.25
"""Squared distance to the points, times unmoved voxels', that a surface may have.

Where points lie on a surface is not coded, and chance alone keeps them some way off.
"""
