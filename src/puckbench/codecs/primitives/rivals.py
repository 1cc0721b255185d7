"""Ways to code a cloud: each is tried, judged by what it costs and by how near it comes.

Surfaces are coded along the cloud's axes and along its walls', with round surfaces and without.
Voxels get the same number of bytes; the better is kept. Better is judged against the smoothed
surface, for a decode that is nearer to the noisy points than their noise is reproduces noise. But a
surface has also to be as near to the points themselves as the voxels are when they stay where G-PCC
has them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.primitives import voxels
from puckbench.codecs.primitives.axes import best_turn
from puckbench.codecs.primitives.decoder import decode_stream, decode_surface
from puckbench.codecs.primitives.encoder import (
    Cloud,
    Way,
    encode_surface,
    prepared,
    round_surfaces,
)
from puckbench.codecs.primitives.judge import Judge
from puckbench.codecs.primitives.settings import Settings
from puckbench.codecs.primitives.stream import Header, unpack
from puckbench.errors import InputError


def encode(points: Floats, settings: Settings) -> bytes:
    """Code points (n, 3) as surfaces or as voxels."""
    most = int(settings.bpp * len(points) / 8)
    if float(np.ptp(points, axis=0).max()) == 0:
        return voxels.encode_at(points, 1.0)
    if settings.leaf == 0:
        return voxels.encode_within(points, most, settings.voxel)
    cloud = prepared(points, settings)
    judge = Judge.of(cloud.points, cloud.surface.xyz, cloud.surface.normals)
    surface = _best_surface(cloud, judge)
    if surface is None or len(surface) > most:
        return voxels.encode_within(points, most)
    rival = voxels.encode_within(points, len(surface))
    return surface if _surface_wins(cloud, judge, surface, rival) else rival


_MOST_REFUSED = 3
"""Round surfaces in a row that cost more than they save, after which no more are tried."""


class _Try(NamedTuple):
    """A way to code a surface, what it costs (error + price x bits), and the stream."""

    cost: float
    way: Way
    stream: bytes | None


def _best_surface(cloud: Cloud, judge: Judge) -> bytes | None:
    """The surface that costs least; None where there are too few points."""
    best = _tried(cloud, judge, Way())
    turn = best_turn(cloud.surface.normals)
    if any(turn):
        best = min(best, _tried(cloud, judge, Way(turn)), key=lambda found: found.cost)
    refused = 0
    for surface in round_surfaces(cloud):
        more = _tried(cloud, judge, best.way._replace(rounds=(*best.way.rounds, surface)))
        refused = refused + 1 if more.cost >= best.cost else 0
        best = min(best, more, key=lambda found: found.cost)
        if refused == _MOST_REFUSED:
            break
    return best.stream


def _tried(cloud: Cloud, judge: Judge, way: Way) -> _Try:
    stream = encode_surface(cloud, way)
    if stream is None:
        return _Try(np.inf, way, None)
    error = judge.to_surface(cloud.in_units(_thinly_decoded(stream)))
    rate = 8 * len(stream) / len(cloud.points)
    return _Try(error + cloud.settings.price * rate, way, stream)


def _thinly_decoded(stream: bytes) -> Floats:
    """Points of a stream of surfaces, fewer than the decoder makes."""
    header, bits = unpack(stream)
    if not isinstance(header, Header):
        raise InputError("the stream holds no surfaces")
    return decode_surface(header._replace(fineness=max(header.fineness // 2, 1)), bits).xyz


def _surface_wins(cloud: Cloud, judge: Judge, surface: bytes, rival: bytes) -> bool:
    own = judge.errors(cloud.in_units(decode_stream(surface)))
    other = judge.errors(cloud.in_units(decode_stream(rival)))
    if own.surface > other.surface:
        return False
    plain = judge.errors(cloud.in_units(voxels.unmoved(rival)))
    return own.plane <= plain.plane and own.point <= plain.point
