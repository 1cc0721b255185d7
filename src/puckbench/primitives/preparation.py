"""Preparation of a cloud: scaling, noise estimation, and smoothed samples of its surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats, bounds
from puckbench.geometry.spatial_order import morton_order
from puckbench.primitives.noise import estimate_noise
from puckbench.primitives.settings import UNITS, Settings
from puckbench.primitives.smoothing import sample_cells, smooth_samples
from puckbench.primitives.stream import MAX_CELLS

_NOISE_CELL = 16.0
_SAMPLE_CELL = 6.0 / 2**0.5
"""Side of a sampling cell, in units, where there are enough points."""
_MIN_CELL_NOISE = 3.0
"""Side of a sampling cell in standard deviations of the noise, at least."""
_MIN_COLUMN_CELL = 1.5
"""Side of a sampling cell in columns, at least."""
_MIN_POINTS_PER_SAMPLE = 2.5
_OUTLIER_NOISE = 6.5
"""Distance from a plane, in standard deviations of the noise, from which on points are outliers."""


class SurfaceSamples(NamedTuple):
    """Smoothed samples: points (n, 3), unit normals, and shares (n,) of the cloud's points.

    spacing: side of a sampling cell. area: share of the area that a sample represents.
    """

    xyz: Floats
    normals: Floats
    shares: Floats
    spacing: float
    area: float

    def only(self, rows: NDArray[np.bool_]) -> SurfaceSamples:
        """Some of the samples, with the shares that they have."""
        chosen = (self.xyz[rows], self.normals[rows], self.shares[rows])
        return SurfaceSamples(*chosen, self.spacing, self.area)


class PreparedCloud(NamedTuple):
    """A cloud in units: points (n, 3) in Morton order, and its smoothed surface.

    source: (n, 3) the same points in the input's coordinates. corner: (3,) their least ones. unit:
    length of a unit in the input. noise: standard deviation in units. settings: of the rate,
    adapted to the noise.
    """

    points: Floats
    source: Floats
    corner: Floats
    unit: float
    noise: float
    surface: SurfaceSamples
    settings: Settings

    def in_units(self, points: Floats) -> Floats:
        """Points (m, 3) of the input's coordinates in units."""
        return np.asarray((points - self.corner) / self.unit)


def prepare(points: Floats, settings: Settings) -> PreparedCloud:
    """Scale points (n, 3), which must not all be equal, to units and smooth their surface."""
    source = points[morton_order(points)]
    corner, end = bounds(source)
    unit = float((end - corner).max()) / UNITS
    points = (source - corner) / unit
    noise = estimate_noise(points, _NOISE_CELL)
    settings = settings.adapted_to(noise)
    surface = _smoothed_surface(points, noise, settings)
    return PreparedCloud(points, source, corner, unit, noise, surface, settings)


def column_size(surface: SurfaceSamples, settings: Settings) -> float:
    """Side of a column in units: no finer than the spacing of the samples supports."""
    doublings = np.log2(0.6 * surface.spacing / settings.column_size)
    column = settings.column_size * 2.0 ** max(0, np.ceil(doublings - 1e-9))
    while np.prod(np.ptp(surface.xyz, axis=0) / column + 2) > MAX_CELLS:
        column *= 2
    return float(column)


def column_size_of(cloud: PreparedCloud) -> float:
    """Side of a column along the cloud's own axes, in units."""
    return column_size(cloud.surface, cloud.settings)


def _smoothed_surface(points: Floats, noise: float, settings: Settings) -> SurfaceSamples:
    """Smoothed samples of points in units, in cells large enough to hold a few points each.

    The side of a cell is `_SAMPLE_CELL` times 2^(k/2), so that no rate has coarser cells than a
    lower one.
    """
    least = max(_MIN_COLUMN_CELL * settings.column_size, _MIN_CELL_NOISE * noise)
    finer = np.log2(max(_SAMPLE_CELL / least, 1.0))
    spacing = float(_SAMPLE_CELL * 2.0 ** (-np.ceil(2 * finer - 1e-9) / 2))
    samples = sample_cells(points, spacing)
    while len(points) < _MIN_POINTS_PER_SAMPLE * len(samples.xyz) and spacing < UNITS / 4:
        spacing *= 2**0.5
        samples = sample_cells(points, spacing)
    radius = max(settings.smoothing_radius * noise, 1.5 * spacing)
    band = max(_OUTLIER_NOISE * noise, spacing / 2)
    xyz, normals = smooth_samples(samples, spacing, radius, band)
    return SurfaceSamples(xyz, normals, samples.counts / len(points), spacing, 1 / len(xyz))
