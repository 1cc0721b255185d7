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
    """Maker of solids, tessellated according to their size, and of random dimensions.

    Parameters
    ----------
    rng
        Source of all random numbers, drawn in the order of the calls.
    detail
        Factor of the number of segments (1: 12 mm segments, 16 to 96 per full circle).
    unit
        Metres per unit of the model, for the tessellation.
    """

    rng: np.random.Generator
    detail: float = 1.0
    unit: float = 1.0

    def steps(self, radius: float) -> int:
        """Return the number of segments of a full circle, a multiple of 4."""
        segments = np.clip(2 * np.pi * radius * self.unit / 0.012, 16, 96) * self.detail
        return max(8, 4 * round(float(segments) / 4))

    def pick(self, choices: Sequence[T]) -> T:
        return choices[int(self.rng.integers(len(choices)))]

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def chance(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    box = staticmethod(solids.box)

    def slab(self, x: float, y: float, z: float, radius: float) -> Surface:
        """Make a box on z = 0 with rounded vertical edges."""
        steps = max(2, self.steps(radius) // 4)
        return solids.extrude(rounded_rectangle(x, y, radius, steps), z)

    def cylinder(self, radius: float, height: float) -> Surface:
        return solids.cylinder(radius, height, self.steps(radius))

    def rod(self, start: Sequence[float], end: Sequence[float], radius: float) -> Surface:
        return solids.pipe([start, end], radius, radius, self.steps(radius))

    def pipe(self, points: Sequence[Sequence[float]], radius: float, bend: float) -> Surface:
        return solids.pipe(points, radius, bend, self.steps(radius))

    def legs(self, foot: Point, top: Point, height: float, radius: float) -> list[Surface]:
        """Make four rods from (+-x, +-y) of `foot`, on z = 0, to (+-x, +-y) of `top`."""
        (x0, y0), (x1, y1) = foot, top
        sides = [(a, b) for a in (-1, 1) for b in (-1, 1)]
        return [self.rod((a * x0, b * y0, 0), (a * x1, b * y1, height), radius) for a, b in sides]

    def handle(
        self, start: Sequence[float], end: Sequence[float], y: float, radius: float
    ) -> Surface:
        """Make a bar handle at depth `y` between two points of a furniture front (x-z plane)."""
        path = [start, (start[0], y, start[2]), (end[0], y, end[2]), end]
        return self.pipe(path, radius, 2 * radius)

    def cone(self, bottom: float, top: float, height: float) -> Surface:
        return solids.cone(bottom, top, height, self.steps(max(bottom, top)))

    def sphere(self, radius: float) -> Surface:
        return solids.sphere(radius, self.steps(radius))

    def torus(self, major: float, minor: float) -> Surface:
        return solids.torus(major, minor, self.steps(major), self.steps(minor))

    def superquadric(
        self, sizes: tuple[float, float, float], exponents: tuple[float, float] = (1.0, 1.0)
    ) -> Surface:
        return solids.superquadric(sizes, exponents, self.steps(0.35 * max(sizes)))

    def cushion(self, x: float, y: float, z: float, roundness: float = 0.35) -> Surface:
        sizes = (x / 2, y / 2, z / 2)
        return self.superquadric(sizes, (roundness, roundness)).at(z=z / 2)

    def turned(self, *paths: Outline, degrees: float = 360.0) -> Surface:
        """Revolve a profile of successive paths of (r, z) points, as `solids.revolve` does."""
        profile = tuple(segment for path in paths for segment in path)
        radius = max(float(segment.points[:, 0].max()) for segment in profile)
        return solids.revolve(profile, self.steps(radius), degrees)

    def vessel(self, points: Sequence[Point], wall: float) -> Surface:
        """Make an open vessel whose smooth outside passes through (r, z) points, bottom to rim."""
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
        return solids.tube(path, radius, self.steps(float(np.max(radius))), closed=closed)

    def smooth(self, points: Sequence[Sequence[float]], steps: int = 8) -> Floats:
        segments = max(2, round(steps * self.detail))
        return catmull_rom(np.array(points, dtype=np.float64), segments)
