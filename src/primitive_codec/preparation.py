from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats, bounds
from pointkit.geometry.spatial_order import morton_order
from primitive_codec.cells import group_by_cell
from primitive_codec.distortion import Distortion, DistortionEstimator
from primitive_codec.octree import moments_of, plane_errors
from primitive_codec.settings import UNITS, PrimitiveSettings
from primitive_codec.smoothing import downsample, smooth_samples
from primitive_codec.stream import MAX_CELLS

_NOISE_CELL_SIZE = 16.0
_MIN_POINTS = 8
"""Least number of points of a cell from which noise is estimated."""
_DEFAULT_SPACING = 6.0 / 2**0.5
"""Default side of a sampling cell, in units."""
_SPACING_PER_NOISE = 3.0
"""Target sample spacing, in standard deviations of the noise."""
_SPACING_PER_COLUMN = 1.5
"""Target sample spacing, in columns."""
_MIN_POINTS_PER_SAMPLE = 2.5
_OUTLIER_DISTANCE_PER_NOISE = 6.5
"""Outlier distance of smoothing, in standard deviations of the noise."""


class SurfaceSamples(NamedTuple):
    """Smoothed samples of a cloud's surface, one for each occupied cell of a sampling grid."""

    xyz: Floats  # (n, 3)
    normals: Floats  # (n, 3) unit normals
    point_weights: Floats  # (n,) fractions of the cloud's points
    spacing: float  # side of a sampling cell
    area_weight: float  # fraction of the area that each sample represents

    def masked(self, mask: NDArray[np.bool_]) -> SurfaceSamples:
        """Return only the samples for which the mask (n,) is true."""
        arrays = (self.xyz[mask], self.normals[mask], self.point_weights[mask])
        return SurfaceSamples(*arrays, self.spacing, self.area_weight)


class PreparedCloud(NamedTuple):
    """A cloud that is ready for encoding, with smoothed samples of its surface.

    A unit is 1/1023 of the cloud's longest side.
    """

    points: Floats  # (n, 3) in units, in Morton order
    source: Floats  # (n, 3) the same points in the input's coordinates
    corner: Floats  # (3,) least input coordinates
    unit: float  # length of a unit in the input
    noise: float  # standard deviation in units
    surface: SurfaceSamples  # in units
    settings: PrimitiveSettings  # adapted to the noise
    estimator: DistortionEstimator  # in units

    def in_units(self, points: Floats) -> Floats:
        """Convert points (k, 3) from the input's coordinates to units."""
        return np.asarray((points - self.corner) / self.unit)

    def distortion(self, decoded: Floats) -> Distortion:
        """Estimate the distortion of decoded points.

        Parameters
        ----------
        decoded
            Points (k, 3) in the input's coordinates.

        Returns
        -------
        Distortion
            Three mean squared errors, in squared units.
        """
        return self.estimator.measure(self.in_units(decoded))


def prepare(points: Floats, settings: PrimitiveSettings) -> PreparedCloud:
    """Scale a cloud, estimate its noise, and smooth its surface, before any mode is tried.

    Parameters
    ----------
    points
        Coordinates (n, 3) in any unit; at least two points must differ.
    settings
        The rate, before it is adapted to the noise.

    Returns
    -------
    PreparedCloud
        The points in units of 1/1023 of the longest side, with samples of the surface and the
        adapted settings.
    """
    source = points[morton_order(points)]
    corner, high = bounds(source)
    unit = float((high - corner).max()) / UNITS
    points = (source - corner) / unit
    noise = estimate_noise(points, _NOISE_CELL_SIZE)
    settings = settings.adapted_to(noise)
    surface = _smoothed_surface(points, noise, settings)
    estimator = DistortionEstimator.of(points, *surface[:3])
    return PreparedCloud(points, source, corner, unit, noise, surface, settings, estimator)


def column_size(surface: SurfaceSamples, settings: PrimitiveSettings) -> float:
    """Return the side of an occupancy map's column, in units.

    The side in the settings is doubled until columns are not much narrower than the distance of the
    samples, and until the grid has at most `MAX_CELLS` cells.
    """
    doublings = np.log2(0.6 * surface.spacing / settings.column_size)
    column = settings.column_size * 2.0 ** max(0, np.ceil(doublings - 1e-9))
    while np.prod(np.ptp(surface.xyz, axis=0) / column + 2) > MAX_CELLS:
        column *= 2
    return float(column)


def axis_aligned_column_size(cloud: PreparedCloud) -> float:
    """Return the `column_size` of a grid along the cloud's axes."""
    return column_size(cloud.surface, cloud.settings)


def _smoothed_surface(points: Floats, noise: float, settings: PrimitiveSettings) -> SurfaceSamples:
    target_spacing = max(_SPACING_PER_COLUMN * settings.column_size, _SPACING_PER_NOISE * noise)
    # Spacings are powers of sqrt(2), so that no rate has larger cells than a lower rate.
    octaves = np.log2(max(_DEFAULT_SPACING / target_spacing, 1.0))
    spacing = float(_DEFAULT_SPACING * 2.0 ** (-np.ceil(2 * octaves - 1e-9) / 2))
    samples = downsample(points, spacing)
    while len(points) < _MIN_POINTS_PER_SAMPLE * len(samples.xyz) and spacing < UNITS / 4:
        spacing *= 2**0.5
        samples = downsample(points, spacing)
    radius = max(settings.smoothing_radius * noise, 1.5 * spacing)
    outlier_distance = max(_OUTLIER_DISTANCE_PER_NOISE * noise, spacing / 2)
    xyz, normals = smooth_samples(samples, spacing, radius, outlier_distance)
    return SurfaceSamples(xyz, normals, samples.counts / len(points), spacing, 1 / len(xyz))


def estimate_noise(points: Floats, cell_size: float) -> float:
    """Estimate the standard deviation of the noise of points on surfaces.

    In each cell of a grid, a plane is fitted to the points. The estimate is the lower quartile of
    the cells' deviations, weighted by numbers of points, because curved and crossing surfaces raise
    only higher quantiles.

    Parameters
    ----------
    points
        Coordinates (n, 3).
    cell_size
        Side of a cell, in the unit of the points.

    Returns
    -------
    float
        The standard deviation in the unit of the points, or 0 if no cell has enough points.
    """
    rows, starts = group_by_cell(points, cell_size).sorted_rows()
    centred = points[rows] - points.mean(axis=0)
    moments = np.add.reduceat(moments_of(centred), starts, axis=0)
    moments = moments[moments[:, 0] >= _MIN_POINTS]
    if not len(moments):
        return 0.0
    counts = moments[:, 0]
    variance = plane_errors(moments) / (counts - 3)
    ascending = np.argsort(variance, kind="stable")
    cumulative_counts = np.cumsum(counts[ascending])
    quartile = np.searchsorted(cumulative_counts, cumulative_counts[-1] / 4)
    return float(np.sqrt(variance[ascending[quartile]]))
