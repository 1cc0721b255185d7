from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import written
from pointkit.geometry.cloud import Floats
from primitive_codec.decoder import (
    DecodedSurface,
    Patches,
    count_columns,
    count_surface_points,
    empty_octree,
    reconstruct_surface,
)
from primitive_codec.entropy import writer
from primitive_codec.manhattan_frame import RotationVector, rotate, rotation_matrix
from primitive_codec.occupancy_map import OccupancyCriterion, code_occupancy_maps
from primitive_codec.octree import PlaneOctreeLevel, build_octree, collect_leaves, prune_octree
from primitive_codec.octree_arrays import SPACING_UNIT, EncoderNodes, Ints
from primitive_codec.preparation import (
    PreparedCloud,
    SurfaceSamples,
    axis_aligned_column_size,
    column_size,
)
from primitive_codec.region_merging import MergeLimits, region_moments
from primitive_codec.revolution import (
    CONTEXTS,
    MIXERS,
    RevolutionSurface,
    UnrolledMap,
    code_unrolled_map,
    pack_parameters,
    unpack_parameters,
)
from primitive_codec.revolution_occupancy import RevolutionCosts, fit_revolutions, to_grid
from primitive_codec.settings import PrimitiveSettings
from primitive_codec.shape_detection import detect_revolutions
from primitive_codec.stream import (
    MAX_COLUMNS,
    MAX_POINT_SPACING,
    MAX_POINTS,
    MIN_POINT_SPACING,
    SurfaceHeader,
    is_decodable,
    pack_surface,
    unpack_surface,
)
from primitive_codec.traversal import code_octree

_DISC_RADIUS = 0.6
"""Radius of the disc that a sample represents, in sampling cells."""
_LEAF_BITS, _SPLIT_BITS = 6.0, 5.0
_EDGE_BITS = 3.0
_REGION_BITS = 25.0
"""Estimated bits saved if two leaves share a plane."""
_REGION_ERROR_PER_NOISE = 1.0
"""Largest squared error that a merge may add per point, in variances of the noise."""
_MIN_REGION_COSINE = 0.5
_MIN_LAMBDA_PER_NOISE = 3.0
"""Least lambda for map edges and region merging, in variances of the noise. A smaller lambda would
reproduce noise that remains after smoothing."""
_OMISSION_ERROR, _TANGENTIAL_WEIGHT, _MAX_ERROR = 20.0, 0.1, 100.0
_MIN_OMISSION_ERROR = 0.3
"""Smallest squared error of an omitted sample, in squared columns."""
_BYTES_PER_NODE = 64
_TOLERANCE_PER_COLUMN, _TOLERANCE_PER_NOISE = 0.3, 0.5
"""Tolerance of inliers of a surface of revolution, in columns plus standard deviations of the
noise."""
_MIN_PLANE_SAMPLES = 16
"""Approximate number of samples kept for planes if all lie on surfaces of revolution."""


class SurfaceMode(NamedTuple):
    """A candidate way to code a surface: a placement of the grid, and round surfaces."""

    rotation: RotationVector = (0, 0, 0)  # from the cloud's axes to the grid's
    grid_offset: tuple[float, float, float] = (0.5, 0.5, 0.5)  # columns from grid to surface
    revolutions: tuple[RevolutionSurface, ...] = ()  # to try, in units


class CodedSurface(NamedTuple):
    """An encoded surface: the stream, and the primitives that a decoder reads from it."""

    stream: bytes
    patches: Patches

    def with_points(self, count: int) -> CodedSurface:
        """Return the surface with a point spacing at which it decodes to at most `count` points.

        If there is no such spacing that leaves a point, the surface is returned unchanged.
        """
        spacing = _point_spacing(self.patches, count)
        if spacing is None:
            return self
        header, payload = unpack_surface(self.stream)
        header = header._replace(point_spacing=spacing)
        return CodedSurface(pack_surface(header, payload), self.patches._replace(header=header))

    def decoded(self) -> DecodedSurface:
        """Return the points that the decoder will reconstruct, without decoding the stream."""
        header, _ = unpack_surface(self.stream)
        return reconstruct_surface(self.patches._replace(header=header))


def revolution_candidates(cloud: PreparedCloud) -> tuple[RevolutionSurface, ...]:
    """Detect cylinders, cones and spheres in a cloud.

    Returns
    -------
    tuple of RevolutionSurface
        The surfaces in units of 1/1023 of the longest side; those with most inliers come first.
    """
    surface = cloud.surface
    spacing, tolerance = surface.spacing, _tolerance(cloud)
    return tuple(detect_revolutions(surface.xyz, surface.normals, spacing, tolerance))


def point_corner_offset(cloud: PreparedCloud) -> tuple[float, float, float]:
    """Return the offset, in columns, of a grid that begins at the points' lowest corner.

    The default grid begins at the lowest corner of the smoothed surface.
    """
    corner = np.maximum(cloud.surface.xyz.min(axis=0), 0)
    x, y, z = (0.5 + corner / axis_aligned_column_size(cloud)).tolist()
    return (x, y, z)


def encode_surface(cloud: PreparedCloud, mode: SurfaceMode) -> CodedSurface | None:
    """Encode a cloud as a surface in a given mode.

    Returns
    -------
    CodedSurface or None
        None if the stream would exceed the limits of a decoder, or would decode to no points or to
        more points than the cloud has.
    """
    surface, matrix = cloud.surface, rotation_matrix(mode.rotation)
    xyz = rotate(surface.xyz, matrix)
    corner = xyz.min(axis=0)
    surface = surface._replace(xyz=xyz - corner, normals=rotate(surface.normals, matrix))
    column_side = column_size(surface, cloud.settings)
    xyz = np.maximum(surface.xyz / column_side + mode.grid_offset, 0.0)
    surface = surface._replace(xyz=xyz, spacing=surface.spacing / column_side)
    maps, surface = _fit_revolutions(surface, cloud, mode, corner, column_side)
    header, levels = _plan_octree(surface, cloud.settings, column_side)
    start = corner - np.array(mode.grid_offset) * column_side
    header = header._replace(
        origin=rotate(cloud.corner[None], matrix)[0] + cloud.unit * start,
        cell_size=column_side * cloud.unit,
        rotation=mode.rotation,
        revolutions=b"".join(pack_parameters(unrolled.surface) for unrolled in maps),
    )
    if not is_decodable(header):
        return None
    coded = _code_patches(header, levels, surface, maps, cloud, column_side)
    if coded is None:
        return None
    patches, payload = coded
    spacing = _point_spacing(patches, len(cloud.points))
    if spacing is None:
        return None
    header = header._replace(point_spacing=spacing)
    return CodedSurface(pack_surface(header, payload), patches._replace(header=header))


def _code_patches(
    header: SurfaceHeader,
    levels: list[PlaneOctreeLevel],
    surface: SurfaceSamples,
    maps: list[UnrolledMap],
    cloud: PreparedCloud,
    column_side: float,
) -> tuple[Patches, bytes] | None:
    point_count, lmbda = len(cloud.points), _lambda_in_columns(cloud, column_side)
    octree = empty_octree(header, lmbda)
    levels_of_leaves = (header.coarsest_leaf_level, header.finest_leaf_level)
    prune_octree(levels, lmbda, _LEAF_BITS, _SPLIT_BITS, *levels_of_leaves)
    variance = (cloud.noise / column_side) ** 2
    map_lmbda = max(lmbda, _MIN_LAMBDA_PER_NOISE * variance / point_count)
    max_added = (_REGION_BITS * map_lmbda, _REGION_ERROR_PER_NOISE * variance)
    limits = MergeLimits(*max_added, _MIN_REGION_COSINE)
    map_columns = sum(len(unrolled.bits) for unrolled in maps)
    node_bytes = _BYTES_PER_NODE + 2 * 4 ** (header.depth - header.finest_leaf_level)
    max_bytes = 4096 + node_bytes * header.leaf_capacity + map_columns // 4
    coder = writer(CONTEXTS, MIXERS, max_bytes)
    nodes = _encoder_nodes(levels, octree.geometry.shape, limits)
    if not code_octree(coder, octree, nodes) or count_columns(octree.leaves) > MAX_COLUMNS:
        return None
    criterion = _occupancy_criterion(surface, map_lmbda, column_side)
    code_occupancy_maps(coder, octree, criterion)
    for unrolled in maps:
        code_unrolled_map(coder, unrolled.surface.columns_per_row(), unrolled.bits)
    decoded = unpack_parameters(header.revolutions)
    revolutions = [
        unrolled._replace(surface=surface) for surface, unrolled in zip(decoded, maps, strict=True)
    ]
    return Patches(header, octree, revolutions), written(coder.bits)


def _tolerance(cloud: PreparedCloud) -> float:
    return _TOLERANCE_PER_COLUMN * cloud.settings.column_size + _TOLERANCE_PER_NOISE * cloud.noise


def _lambda_in_columns(cloud: PreparedCloud, column_side: float) -> float:
    return cloud.settings.lmbda / column_side**2 / len(cloud.points)


def _omission_error(column_side: float) -> float:
    return max(_OMISSION_ERROR / column_side**2, _MIN_OMISSION_ERROR)


def _fit_revolutions(
    surface: SurfaceSamples,
    cloud: PreparedCloud,
    mode: SurfaceMode,
    corner: Floats,
    column_side: float,
) -> tuple[list[UnrolledMap], SurfaceSamples]:
    if not mode.revolutions:
        return [], surface
    placement = (rotation_matrix(mode.rotation), corner, column_side, mode.grid_offset)
    grid_surfaces = [to_grid(revolution, *placement) for revolution in mode.revolutions]
    lmbda = _lambda_in_columns(cloud, column_side)
    costs = RevolutionCosts(
        omission_error=_omission_error(column_side),
        tangential_weight=_TANGENTIAL_WEIGHT,
        max_error=_MAX_ERROR / column_side**2,
        tolerance=_tolerance(cloud) / column_side,
        spacing=surface.spacing,
        edge_cost=_EDGE_BITS * lmbda * surface.spacing**2 / (surface.area_weight / 2),
    )
    weights = surface.point_weights / surface.area_weight
    maps, unexplained = fit_revolutions(grid_surfaces, surface.xyz, surface.normals, weights, costs)
    unexplained[:: -(-len(unexplained) // _MIN_PLANE_SAMPLES)] = True
    return maps, surface.masked(unexplained)


def _plan_octree(
    surface: SurfaceSamples, settings: PrimitiveSettings, column_side: float
) -> tuple[SurfaceHeader, list[PlaneOctreeLevel]]:
    shape = np.floor(surface.xyz.max(axis=0)).astype(np.int64) + 1
    depth = (int(shape.max()) - 1).bit_length()
    finest = max(depth - round(np.log2(max(settings.min_leaf_size / column_side, 1))), 0)
    coarsest = max(depth - round(np.log2(max(settings.max_leaf_size / column_side, 1))), 0)
    weights = surface.point_weights / 2 + surface.area_weight / 2
    radius = _DISC_RADIUS * surface.spacing
    levels = build_octree(surface.xyz, surface.normals, weights, radius, depth)
    x, y, z = shape.tolist()
    header = SurfaceHeader(
        origin=np.zeros(3),
        cell_size=1.0,
        shape=(x, y, z),
        depth=depth,
        finest_leaf_level=finest,
        coarsest_leaf_level=min(max(coarsest, depth - 8), finest),
        plane_step=min(max(round(16 * settings.plane_step / column_side), 1), 255),
        point_spacing=SPACING_UNIT,
        leaf_capacity=len(levels[finest].cells) + 8,
    )
    return header, levels


def _encoder_nodes(
    levels: list[PlaneOctreeLevel], shape: Ints, limits: MergeLimits
) -> EncoderNodes:
    moments = np.concatenate([level.moments for level in levels])
    leaf_nodes, leaves = collect_leaves(levels)
    regions = np.zeros_like(moments)
    regions[leaf_nodes] = region_moments(moments[leaf_nodes], leaves, shape, limits)
    starts = np.cumsum([0] + [len(level.cells) for level in levels])
    first_child = [
        level.first_child[:-1] + start for level, start in zip(levels, starts[1:], strict=True)
    ]
    cells = np.concatenate([level.cells for level in levels]) & 1
    return EncoderNodes(
        moments,
        np.concatenate([*first_child, starts[-1:]]),
        np.concatenate([level.is_leaf for level in levels]),
        cells @ np.array([4, 2, 1]),
        regions,
    )


def _occupancy_criterion(
    surface: SurfaceSamples, lmbda: float, column_side: float
) -> OccupancyCriterion:
    cells = np.floor(surface.xyz / surface.spacing).astype(np.int64)
    sample_at = np.zeros(cells.max(axis=0) + 1, np.int32)
    sample_at[tuple(cells.T)] = np.arange(1, len(cells) + 1)
    return OccupancyCriterion(
        surface.xyz,
        surface.normals,
        surface.point_weights / 2,
        sample_at,
        spacing=surface.spacing,
        tangential_weight=_TANGENTIAL_WEIGHT,
        max_error=_MAX_ERROR / column_side**2,
        omission_error=_omission_error(column_side),
        area_weight=surface.area_weight / 2,
        edge_cost=_EDGE_BITS * lmbda,
    )


def _point_spacing(patches: Patches, max_points: int) -> int | None:
    most = min(max_points, MAX_POINTS)
    low, high = MIN_POINT_SPACING - 1, MAX_POINT_SPACING
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (
            (low, middle) if count_surface_points(patches, middle) <= most else (middle, high)
        )
    return high if 0 < count_surface_points(patches, high) <= most else None
