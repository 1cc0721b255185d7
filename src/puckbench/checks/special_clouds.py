"""Checks with clouds of one point, of equal points, without extent, and far from the origin."""

from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.checks.registry import CHECKS, Fault
from puckbench.checks.subject import Subject, farthest_of_both, single_return

_COORDINATE = "keep what the finest rate loses within its step, whatever the extent"


@CHECKS.register(
    "one_point", rank=50, advice="do not divide by an extent of 0, and treat n = 1 as any other n"
)
def one_point(subject: Subject) -> str:
    """Encode a cloud of one point."""
    if subject.kind == "returns":
        return _comes_back(subject, single_return())
    return _comes_back(subject, subject.of(np.array([[3.0, 2.0, 1.0]])))


@CHECKS.register(
    "equal_points", rank=60, advice="do not divide by a distance between points, which may be 0"
)
def equal_points(subject: Subject) -> str:
    """Encode two equal points, and points that occur twenty times."""
    two, many = np.full((2, 3), 5.0), np.repeat([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 20, axis=0)
    lines = [_comes_back(subject, subject.of(points)) for points in (two, many)]
    return lines[-1]


@CHECKS.register(
    "lines_and_planes", rank=70, advice="do not divide by the extent along an axis, which may be 0"
)
def lines_and_planes(subject: Subject) -> str:
    """Encode points of a line and of a plane, some with negative coordinates."""
    steps, zeros = np.arange(-10.0, 20.0), np.zeros(30)
    line = np.column_stack([steps, zeros, zeros])
    plane = np.column_stack([steps, steps**2 % 17, np.full(30, -4.0)])
    lines = [_comes_back(subject, subject.of(points)) for points in (line, plane)]
    return lines[-1]


@CHECKS.register(
    "far_cloud", rank=80, advice="let puckbench shift far clouds: encode what it passes"
)
def far_cloud(subject: Subject) -> str:
    """Encode a cloud with coordinates as of maps, a thousand kilometres from the origin."""
    points = np.round(subject.cloud.xyz / subject.unit)
    far = np.array([500_000.0, 5_000_001.0, -3_000_000.0]) / subject.unit
    return _comes_back(subject, subject.of(points + far))


def _comes_back(subject: Subject, cloud: PointCloud) -> str:
    """Encode and decode a cloud at the finest rate, and compare it with the original."""
    rate = subject.finest
    decoded: Floats = subject.decode(subject.encode(cloud, rate)).xyz
    if not len(decoded):
        raise Fault(f"{rate}: no point comes back: code every point")
    if len(decoded) > len(cloud) and not subject.estimates:
        more = f"{len(decoded)} points for {len(cloud)}"
        raise Fault(f"{rate}: {more}: decode no more than were coded")
    error = farthest_of_both(cloud.xyz, decoded)
    if not subject.estimates and error > subject.tolerance():
        raise Fault(
            f"{rate}: points are off by up to {error:.3g}, and by half of "
            f"{subject.tolerance():.3g} on a usual cloud: {_COORDINATE}"
        )
    points = f"{len(cloud):,} points" if len(cloud) > 1 else "1 point"
    return f"{points}, {len(decoded):,} decoded"
