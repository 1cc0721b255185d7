from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes import solids
from virtual_lidar.scenes.outlines import (
    Outline,
    Point,
    Segment,
    catmull_rom,
    line,
    rounded_rectangle,
)
from virtual_lidar.scenes.surfaces import Surface

T = TypeVar("T")


@dataclass(frozen=True)
class Modeller:
    """Makes solids and random dimensions, from which models of objects are composed.

    A solid stands on the plane z = 0 unless its method says otherwise. The number of segments of a
    curved part depends on its size. Parameters that are not explained here are those of the
    functions of the same names in `solids`.

    Parameters
    ----------
    rng
        Source of all random numbers, which are drawn in the order of the calls.
    detail
        Factor of the number of segments. With 1, segments are 12 mm long, and a full circle has 16
        to 96 segments.
    unit
        Length of one unit of the model in metres, by which the number of segments is chosen.
    """

    rng: np.random.Generator
    detail: float = 1.0
    unit: float = 1.0

    def steps(self, radius: float) -> int:
        """Return the number of segments of a full circle with a given radius, a multiple of 4."""
        segments = np.clip(2 * np.pi * radius * self.unit / 0.012, 16, 96) * self.detail
        return max(8, 4 * round(float(segments) / 4))

    def pick(self, choices: Sequence[T]) -> T:
        """Return one of the choices at random."""
        return choices[int(self.rng.integers(len(choices)))]

    def between(self, low: float, high: float) -> float:
        """Return a random number from `low` to `high`."""
        return float(self.rng.uniform(low, high))

    def chance(self, probability: float) -> bool:
        """Return True with the given probability, otherwise False."""
        return bool(self.rng.random() < probability)

    box = staticmethod(solids.box)

    def slab(self, x: float, y: float, z: float, radius: float) -> Surface:
        """Make a box of size (x, y, z) whose vertical edges are rounded with a radius."""
        steps = max(2, self.steps(radius) // 4)
        return solids.extrude(rounded_rectangle(x, y, radius, steps), z)

    def cylinder(self, radius: float, height: float) -> Surface:
        """Make an upright cylinder."""
        return solids.cylinder(radius, height, self.steps(radius))

    def rod(self, start: Sequence[float], end: Sequence[float], radius: float) -> Surface:
        """Make a round rod from one point to another."""
        return solids.pipe([start, end], radius, radius, self.steps(radius))

    def pipe(self, points: Sequence[Sequence[float]], radius: float, bend: float) -> Surface:
        """Make a round pipe along points, with elbows of the radius `bend`."""
        return solids.pipe(points, radius, bend, self.steps(radius))

    def legs(self, foot: Point, top: Point, height: float, radius: float) -> list[Surface]:
        """Make four rods from the points (+-x, +-y) of `foot`, z = 0, to (+-x, +-y) of `top`."""
        (x0, y0), (x1, y1) = foot, top
        sides = [(a, b) for a in (-1, 1) for b in (-1, 1)]
        return [self.rod((a * x0, b * y0, 0), (a * x1, b * y1, height), radius) for a, b in sides]

    def handle(
        self, start: Sequence[float], end: Sequence[float], y: float, radius: float
    ) -> Surface:
        """Make a handle: a bar at depth `y`, bent back to two points of a front (x-z plane)."""
        path = [start, (start[0], y, start[2]), (end[0], y, end[2]), end]
        return self.pipe(path, radius, 2 * radius)

    def cone(self, bottom: float, top: float, height: float) -> Surface:
        """Make an upright cone, or a frustum, from its radii at the bottom and at the top."""
        return solids.cone(bottom, top, height, self.steps(max(bottom, top)))

    def sphere(self, radius: float) -> Surface:
        """Make a sphere around the origin."""
        return solids.sphere(radius, self.steps(radius))

    def torus(self, major: float, minor: float) -> Surface:
        """Make a torus around the origin, about z."""
        return solids.torus(major, minor, self.steps(major), self.steps(minor))

    def superquadric(
        self, sizes: tuple[float, float, float], exponents: tuple[float, float] = (1.0, 1.0)
    ) -> Surface:
        """Make a superellipsoid around the origin, by default an ellipsoid with these half axes."""
        return solids.superquadric(sizes, exponents, self.steps(0.35 * max(sizes)))

    def cushion(self, x: float, y: float, z: float, roundness: float = 0.35) -> Surface:
        """Make a rounded box of size (x, y, z); a greater `roundness`, up to 1, is rounder."""
        sizes = (x / 2, y / 2, z / 2)
        return self.superquadric(sizes, (roundness, roundness)).at(z=z / 2)

    def turned(self, *paths: Outline, degrees: float = 360.0) -> Surface:
        """Revolve a profile about z, as `solids.revolve` does; the paths follow each other."""
        profile = tuple(segment for path in paths for segment in path)
        radius = max(float(segment.points[:, 0].max()) for segment in profile)
        return solids.revolve(profile, self.steps(radius), degrees)

    def vessel(self, points: Sequence[Point], wall: float) -> Surface:
        """Make an open vessel with a given thickness of its wall.

        Its smooth outside passes through the points (r, z), from the bottom to the rim.
        """
        outside = catmull_rom(np.array(points, dtype=np.float64), max(3, self.steps(0.2) // 8))
        inside = np.maximum(outside - (wall, 0.0), 0.0)[::-1]
        floor = outside[0, 1] + wall
        inside = inside[inside[:, 1] > floor]
        (r0, z0), (r1, z1) = outside[0], outside[-1]
        low = float(inside[-1, 0])
        profile = (
            *line((0.0, z0), (r0, z0)),
            Segment("curve", outside),
            *line((r1, z1), (r1 - wall, z1)),
            Segment("curve", np.concatenate([[(r1 - wall, z1)], inside])),
            *line((low, float(inside[-1, 1])), (low, floor), (0.0, floor)),
        )
        return self.turned(profile)

    def tube(self, path: Floats, radius: float | Floats, *, closed: bool = False) -> Surface:
        """Sweep a circle along a path (n, 3), with one radius or one for each point."""
        return solids.tube(path, radius, self.steps(float(np.max(radius))), closed=closed)

    def smooth(self, points: Sequence[Sequence[float]], steps: int = 8) -> Floats:
        """Return points of a smooth path through the given points.

        Parameters
        ----------
        points
            Points to pass through.
        steps
            Number of segments between two of these points, at detail 1.
        """
        segments = max(2, round(steps * self.detail))
        return catmull_rom(np.array(points, dtype=np.float64), segments)
