"""Points of a spinning sensor as integers: ranges in units and azimuths in steps.

In the coordinates that turn with the sensor, all points of a ring are on one line. A point is the
line's point at its range, turned by its azimuth. Decoders compute with sums, products, quotients
and square roots only, which are equal on all machines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.context_mixing import Ints
from pointkit.geometry.cloud import Floats
from puck.clouds.ray_loops import (
    Rows,
    fill_coordinates,
    fill_places,
    fill_refined_ranges,
    fill_turns,
    fitted_line,
)
from puck.records import check

Singles = NDArray[np.float32]
Group = NDArray[np.intp]

_UNITS_M = (0.008, 0.005, 0.004, 0.002, 0.001)
"""Units of which the ranges may be multiples, in the order in which they are tried. If ranges are
multiples of none, they are rounded to the last one, and the differences of the coordinates restore
the points."""
_STEPS = (512, 1024, 1800, 2048, 3600, 4096, 7200, 18000, 36000)
"""Numbers of azimuth steps in a revolution that are tried; the last is the one if none fits."""
_FEW_STEPS = 8192
"""Largest number of steps of which sideways offsets of the lasers are fitted."""
_FEWEST = 12
_MOST_RANGE = (1 << 23) - 2
_MOST_STEPS, _MOST_RINGS = 1 << 16, 256
_TERMS = 27
_OFF, _MOST_OFF = 0.1, 0.1
"""A value is off if it is farther than this share of a unit from a multiple of the unit. Units fit
if at most this share of the values are off."""
_NEAR_M = 1e-3
_MOST_OF_PHASE = 10_000
"""Largest number of azimuths from which the azimuth of step 0 is estimated."""
_LINE = 6
_LARGEST = 1e6
"""Largest absolute value of a number of `Rays` in a stream: coordinates and their increments in m,
and angles in radians."""


class Located(NamedTuple):
    """Points on rays: the rays, and ranges (n,) and azimuths (n,) as integers."""

    rays: Rays
    ranges: Ints
    azimuths: Ints


@dataclass(frozen=True)
class Rays:
    """The lines of the rings, and whether ranges and azimuths of a cloud are exact.

    Parameters
    ----------
    lines
        For each ring (rings, 6), in the turning coordinates: the point at range 0, in metres along
        the beam's azimuth, sideways and up, and its increments per unit of range.
    count
        Number of azimuth steps in a revolution, rounded up.
    step, phase
        Angle of a step, and azimuth of step 0, in radians.
    is_exact
        Whether ranges are multiples of the unit.
    is_stepped
        Whether azimuths are multiples of the step.
    """

    lines: Floats
    count: int
    step: float
    phase: float
    is_exact: bool
    is_stepped: bool

    def packed(self) -> bytes:
        """Return the bytes that `unpacked` reads."""
        head = bytes([self.is_exact | self.is_stepped << 1])
        head += base_128(self.count) + base_128(len(self.lines))
        numbers = np.append([self.step, self.phase], self.lines)
        return head + numbers.astype("<f8").tobytes()

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Read what `packed` wrote; raise InputError if it is damaged."""
        flags, count, rings = reader.take(1)[0], reader.number(), reader.number()
        check(1 <= count <= _MOST_STEPS and 1 <= rings <= _MOST_RINGS)
        numbers = np.frombuffer(reader.take(8 * (2 + _LINE * rings)), "<f8").astype(np.float64)
        check(_are_small(numbers))
        lines = numbers[2:].reshape(rings, _LINE)
        step, phase = float(numbers[0]), float(numbers[1])
        return cls(lines, count, step, phase, bool(flags & 1), bool(flags & 2))

    @property
    def is_storable(self) -> bool:
        """Whether a decoder accepts these rays: no line starts 1,000 km or more from the origin."""
        return _are_small(self.lines) and _are_small(self.phase)

    def packed_phase(self) -> bytes:
        """Return the bytes that `with_phase` reads."""
        return np.array(self.phase, "<f8").tobytes()

    def with_phase(self, reader: Reader) -> Self:
        """Return a copy of these rays with another azimuth of step 0, which `packed_phase` wrote.

        Raises InputError if the bytes are damaged.
        """
        phase = float(np.frombuffer(reader.take(8), "<f8")[0])
        check(_are_small(phase))
        return replace(self, phase=phase)

    def predicted(self, rings: Rows, azimuths: Ints, ranges: Floats) -> tuple[Floats, ...]:
        """Return x, y and z (n,) of points at ranges (n,), which are counted in units."""
        x, y, z = found = np.empty((3, len(rings)))
        circle = _circle(self.count, self.step, self.phase)
        fill_coordinates(self.lines, *circle, rings, azimuths, ranges, found)
        return x, y, z

    def refined(
        self, rings: Rows, azimuths: Ints, values: Singles, is_x: NDArray[np.bool_]
    ) -> Floats:
        """Return the range of each point (n,), in units and not rounded, from one coordinate.

        `values` (n,) are the points' x coordinates where `is_x` (n,) is true, otherwise their y
        coordinates, in m. `rings` (n,) are the points' lasers, and `azimuths` (n,) their steps.
        """
        ranges = np.empty(len(rings))
        circle = _circle(self.count, self.step, self.phase)
        fill_refined_ranges(self.lines, *circle, rings, azimuths, values, is_x, ranges)
        return ranges

    def from_level(self, rings: Rows, x: Singles, y: Singles) -> Floats:
        """Compute ranges from the horizontal distances of points to the sensor's axis.

        Parameters
        ----------
        rings
            Number of the ring of each point, (n,).
        x, y
            Coordinates of the points, (n,), in m.

        Returns
        -------
        array
            Ranges, (n,), in units; they are not rounded.
        """
        wide, long = x.astype(np.float64), y.astype(np.float64)
        along, side, more = self._straight()
        square = wide * wide + long * long - (side * side)[rings]
        return np.asarray((np.sqrt(np.maximum(square, 0.0)) - along[rings]) / more[rings])

    def heights(self, rings: Rows, ranges: Floats) -> Floats:
        """Return z (n,) of points at ranges (n,) in units."""
        return np.asarray(self.lines[rings, 2] + self.lines[rings, 5] * ranges)

    def _straight(self) -> tuple[Floats, Floats, Floats]:
        """Return each line's point at range 0, along its beam and sideways, and its increment."""
        along, side, _, along_more, side_more, _ = self.lines.T
        more = np.sqrt(along_more * along_more + side_more * side_more)
        more = np.where(more == 0, 1.0, more)
        first = (along * along_more + side * side_more) / more
        return first, (side * along_more - along * side_more) / more, more

    def located(self, xyz: Floats, rings: Rows) -> Located | None:
        """Return points (n, 3) on these rays, turned as they are; None if they do not fit."""
        if int(rings.max(initial=0)) >= len(self.lines) or not len(rings):
            return None
        used = self.lines[: int(rings.max()) + 1][np.bincount(rings) > 0]
        if (np.abs(used[:, 3]) + np.abs(used[:, 4]) == 0).any():
            return None
        straight = np.stack(self._straight())
        offsets = np.arctan2(self.lines[:, 4], self.lines[:, 3])
        ranges, around, turns = np.empty((3, len(rings)))
        fill_places(xyz, rings, self.lines, straight, offsets, _NEAR_M, ranges, around)
        whole = np.rint(ranges)
        if self.is_exact and _too_many_off(ranges - whole):
            return None
        rays = self if _is_whole(self.step) else _in_phase(self, around)
        fill_turns(around, rays.phase, rays.step, turns)
        azimuths = np.rint(turns)
        if self.is_stepped and _too_many_off(turns - azimuths):
            return None
        azimuths = np.where(azimuths >= self.count, 0, azimuths)
        return Located(rays, whole.clip(0, _MOST_RANGE).astype(np.int64), azimuths.astype(np.int64))


def _are_small(numbers: Floats | float) -> bool:
    return bool((np.abs(numbers) < _LARGEST).all())  # a nan is not


def _is_whole(step: float) -> bool:
    turns = 2 * np.pi / step
    return abs(turns - round(turns)) < 1e-9


def _in_phase(rays: Rays, around: Floats) -> Rays:
    first, some = float(around[0]), around[:: len(around) // _MOST_OF_PHASE + 1]
    turns = np.mod(some - first, 2 * np.pi) * (2 * np.pi / rays.step)
    off = float(np.arctan2(np.sin(turns).sum(), np.cos(turns).sum())) / (2 * np.pi) * rays.step
    return replace(rays, phase=first + off)


def _too_many_off(rest: Floats) -> bool:
    return int(np.count_nonzero(np.abs(rest) > _OFF)) > _MOST_OFF * len(rest)


@lru_cache(maxsize=4)
def _circle(count: int, step: float, phase: float) -> tuple[Floats, Floats]:
    """Return cosines and sines (count,) of successive azimuths, by power series."""
    angles = np.arange(count) * step + phase
    angles -= np.floor(angles / (2 * np.pi) + 0.5) * (2 * np.pi)
    square = angles * angles
    cosines, sines = np.ones(count), np.ones(count)
    for k in range(_TERMS, 1, -2):
        sines = 1 - sines * square / (k * (k - 1))
        cosines = 1 - cosines * square / ((k - 1) * (k - 2))
    return cosines, sines * angles


def fitted_rays(xyz: Floats, rings: Rows) -> Located | None:
    """Fit the lines of the rings to points.

    Parameters
    ----------
    xyz
        Finite points (n, 3), in metres.
    rings
        Ring of each point (n,).

    Returns
    -------
    Located or None
        The lines and the points on them; None if there are too few points.
    """
    if len(xyz) < _FEWEST:
        return None
    count = int(rings.max()) + 1
    level, around = np.hypot(xyz[:, 0], xyz[:, 1]), np.arctan2(xyz[:, 1], xyz[:, 0])
    order = np.argsort(rings.astype(np.uint16), kind="stable")
    starts = np.searchsorted(rings[order], np.arange(count + 1))
    groups = [order[first:end] for first, end in pairwise(starts)]
    step, phase, is_stepped, offsets, sides = _fitted_steps(around, level, groups)
    level = np.sqrt(np.maximum(level * level - (sides * sides)[rings], 0))
    cones = np.array([_cone(level[rows], xyz[rows, 2]) for rows in groups])
    tangents, heights = cones.T
    cosines = 1 / np.sqrt(1 + tangents * tangents)
    along = (level + (xyz[:, 2] - heights[rings]) * tangents[rings]) * cosines[rings]
    unit, is_exact, starts_m = _fitted_unit(along, groups)
    lines = np.zeros((count, _LINE))
    lines[:, 0], lines[:, 3] = starts_m * cosines, unit * cosines
    lines[:, 2], lines[:, 5] = lines[:, 0] * tangents + heights, lines[:, 3] * tangents
    if is_exact:
        ranges = np.rint((along - starts_m[rings]) / unit)
        _refine_lines(lines, groups, ranges, level, xyz[:, 2])
    lines[:, 1] = sides
    c, s = np.cos(offsets), np.sin(offsets)
    for k in (0, 3):
        lines[:, k], lines[:, k + 1] = (
            lines[:, k] * c - lines[:, k + 1] * s,
            lines[:, k] * s + lines[:, k + 1] * c,
        )
    steps = int(np.ceil(2 * np.pi / step - 1e-6))
    rays = Rays(lines, steps, step, phase, is_exact, is_stepped)
    found = rays.located(xyz, rings)
    if found is None:  # the refined lines do not fit
        found = replace(rays, is_exact=False, is_stepped=False).located(xyz, rings)
    return found


def _fitted_steps(
    around: Floats, level: Floats, groups: list[Group]
) -> tuple[float, float, bool, Floats, Floats]:
    """Fit the azimuth's step, its phase, and each ring's azimuth and sideways offset in metres."""
    for count in _STEPS:
        step = 2 * np.pi / count
        is_stepped, offsets, sides = _fitted_offsets(around, level, groups, step)
        if is_stepped:
            return step, 0.0, True, offsets, sides
    first = float(around[0])
    beyond = np.mod(around - first, 2 * np.pi)
    step = _estimated_step(beyond[max(groups, key=len)])
    if 2 * np.pi / _FEW_STEPS < step < 1:
        is_stepped, offsets, sides = _fitted_offsets(beyond, level, groups, step)
        if is_stepped:
            return step, first, True, offsets, sides
    zeros = np.zeros(len(groups))
    return 2 * np.pi / _STEPS[-1], 0.0, False, zeros, zeros


def _estimated_step(beyond: Floats) -> float:
    """Return the step of which the differences of angles (n,) are multiples, or 0."""
    steps = np.abs(np.diff(beyond))
    steps = steps[steps < 1]
    if len(steps) < _FEWEST:
        return 0.0
    step, span = float(np.median(steps)), 2
    while span < len(beyond) and step > 0:
        apart = np.abs(beyond[span:] - beyond[:-span])
        counts = np.rint(apart / step)
        good = (counts > 0) & (apart < 6)
        if not good.any():
            break
        step, span = float(np.median(apart[good] / counts[good])), 2 * span
    return step


def _fitted_offsets(
    around: Floats, level: Floats, groups: list[Group], step: float
) -> tuple[bool, Floats, Floats]:
    """Return whether azimuths are multiples of a step, and each ring's offsets."""
    offsets, sides, off, seen = np.zeros(len(groups)), np.zeros(len(groups)), 0, 0
    for ring, rows in enumerate(groups):
        if not len(rows):
            continue
        far, turns = np.maximum(level[rows], _NEAR_M), around[rows] / step
        angles = 2 * np.pi * turns
        weights = np.minimum(far, 20.0)
        sine, cosine = (np.sin(angles) * weights).sum(), (np.cos(angles) * weights).sum()
        offset, side = float(np.arctan2(sine, cosine)) / (2 * np.pi), 0.0
        rest = _remainder(turns - offset)
        if step > 2 * np.pi / _FEW_STEPS and np.count_nonzero(np.abs(rest) > 1e-3) > len(rows) // 2:
            for _ in range(4):
                more, sideways = fitted_line(1 / far, rest)
                offset, side = offset + more, side + sideways * step
                rest = _remainder(turns - offset - np.arcsin(np.clip(side / far, -1, 1)) / step)
        offsets[ring], sides[ring] = offset * step, side
        off, seen = off + int(np.count_nonzero(np.abs(rest) > _OFF)), seen + len(rows)
        if off > _MOST_OFF * len(around):
            return False, offsets, sides
    return True, offsets, sides


def _remainder(values: Floats) -> Floats:
    return np.asarray(values - np.rint(values))


def _cone(level: Floats, z: Floats) -> tuple[float, float]:
    """Fit ``z = level * tangent + height``, each point weighted by 1 / level."""
    near = level > _NEAR_M
    if not near.any():
        return 0.0, 0.0
    level, z = level[near], z[near]
    if len(level) < _FEWEST or np.ptp(level) < 0.05 * level.max():
        return float(np.median(z / level)), 0.0
    tangent, height = fitted_line(1 / level, z / level)
    return tangent, height


def _fitted_unit(along: Floats, groups: list[Group]) -> tuple[float, bool, Floats]:
    """Return the unit of ranges, whether they are its multiples, and each ring's range 0."""
    for unit in _UNITS_M:
        starts, off = np.zeros(len(groups)), 0
        for ring, rows in enumerate(groups):
            if len(rows):
                turns = along[rows] / unit
                angles = 2 * np.pi * turns
                phase = np.arctan2(np.sin(angles).sum(), np.cos(angles).sum()) / (2 * np.pi)
                starts[ring] = phase * unit
                off += int(np.count_nonzero(np.abs(_remainder(turns - phase)) > _OFF))
            if off > _MOST_OFF * len(along):
                break
        else:
            return unit, True, starts
    return _UNITS_M[-1], False, np.zeros(len(groups))


def _refine_lines(
    lines: Floats, groups: list[Group], ranges: Floats, level: Floats, z: Floats
) -> None:
    """Fit lines to points of known ranges, where a ring has enough of them."""
    for ring, rows in enumerate(groups):
        if len(rows) >= _FEWEST and np.ptp(ranges[rows]) > 0:
            lines[ring, 0], lines[ring, 3] = fitted_line(ranges[rows], level[rows])
            lines[ring, 2], lines[ring, 5] = fitted_line(ranges[rows], z[rows])
