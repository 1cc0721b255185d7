"""Surface mode: codes a cloud as planes in an octree, surfaces of revolution, occupancy maps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.coding.binary_coder import written
from puckbench.geometry.cloud import Floats
from puckbench.primitives.decoder import (
    DecodedSurface,
    Patches,
    columns_of,
    empty_arrays,
    octree_geometry,
    points_and_normals,
    surface_part,
)
from puckbench.primitives.entropy import writer
from puckbench.primitives.manhattan_frame import (
    RotationVector,
    rotated,
    rotation_matrix,
)
from puckbench.primitives.occupancy_decision import RdCriterion
from puckbench.primitives.occupancy_map import code_occupancy_maps
from puckbench.primitives.octree import Level, build_octree, leaves_of, prune_octree
from puckbench.primitives.octree_arrays import Ints, Nodes
from puckbench.primitives.preparation import (
    PreparedCloud,
    SurfaceSamples,
    column_size,
    column_size_of,
)
from puckbench.primitives.reconstruction import count_points
from puckbench.primitives.region_merging import MergeLimits, region_moments
from puckbench.primitives.revolution import (
    CONTEXTS,
    MIXERS,
    RevolutionSurface,
    code_unrolled_map,
    pack_parameters,
    unpack_parameters,
)
from puckbench.primitives.revolution_occupancy import (
    RevolutionCosts,
    UnrolledMap,
    fit_revolutions,
    to_grid,
)
from puckbench.primitives.settings import Settings
from puckbench.primitives.shape_detection import detect_revolutions
from puckbench.primitives.stream import (
    MAX_COLUMNS,
    MAX_POINTS,
    MAX_REVOLUTION_POINTS,
    SurfaceHeader,
    is_decodable,
    pack_surface,
)
from puckbench.primitives.traversal import code_octree

_DISC_RADIUS = 0.6
"""Radius of the disc that a sample represents, in sampling cells."""
_LEAF_BITS, _SPLIT_BITS = 6.0, 5.0
_EDGE_BITS = 3.0
_REGION_BITS = 25.0
"""Estimated bits saved by leaves that share one plane instead of having two."""
_REGION_NOISE = 1.0
"""Squared distance, in variances of the noise, that a region may add for each of its points."""
_MIN_REGION_COSINE = 0.5
_MIN_LAMBDA_NOISE = 3.0
"""Squared error, in variances of the noise, that a bit for edges and regions must save, at least:
cheaper bits would code what smoothing leaves of the noise."""
_OMISSION_ERROR, _TANGENTIAL_WEIGHT, _MAX_ERROR = 20.0, 0.1, 100.0
_MIN_OMISSION_ERROR = 0.3
"""Squared error of an omitted sample in squared columns, at least."""
_BYTES_PER_NODE = 64
_TOLERANCE, _TOLERANCE_NOISE = 0.3, 0.5
"""Distance of inliers of a surface of revolution, in columns and in deviations of the noise."""
_MIN_PLANE_SAMPLES = 16
"""Samples, about, that are left to planes even if surfaces of revolution explain all."""
_POINT_SPACING = 2.0
_MAX_POINTS_ACROSS, _MAX_COLUMN_SPACING = 16, 16


class SurfaceMode(NamedTuple):
    """A candidate mode of coding a surface.

    rotation: from the cloud's axes to the grid's. margins: columns between the corners of the grid
    and of the surface, along each axis. revolutions: surfaces of revolution, in units.
    """

    rotation: RotationVector = (0, 0, 0)
    margins: tuple[float, float, float] = (0.5, 0.5, 0.5)
    revolutions: tuple[RevolutionSurface, ...] = ()


class CodedSurface(NamedTuple):
    """A stream, and what its decoder reads from it."""

    stream: bytes
    patches: Patches

    def decoded(self) -> DecodedSurface:
        """What a decoder makes of the stream, without reading it again."""
        header, _ = surface_part(self.stream)
        return points_and_normals(self.patches._replace(header=header))


def detect_surfaces(cloud: PreparedCloud) -> tuple[RevolutionSurface, ...]:
    """Cylinders, cones and spheres of a cloud, in units, those with most samples first."""
    surface = cloud.surface
    found = detect_revolutions(surface.xyz, surface.normals, surface.spacing, _tolerance(cloud))
    return tuple(found)


def margins_from_points(cloud: PreparedCloud) -> tuple[float, float, float]:
    """Margins of a grid that begins at the points' corner, which noise moves off outer walls."""
    corner = np.maximum(cloud.surface.xyz.min(axis=0), 0)
    x, y, z = (0.5 + corner / column_size_of(cloud)).tolist()
    return (x, y, z)


def encode_surface(cloud: PreparedCloud, mode: SurfaceMode) -> CodedSurface | None:
    """Code a cloud as surfaces.

    Parameters
    ----------
    cloud
        The prepared cloud, with the settings of the rate.
    mode
        Axes and position of the octree's grid, surfaces of revolution.

    Returns
    -------
    CodedSurface or None
        None if the decoder would make no points, or more than were coded, or refuse the stream.
    """
    surface, corner = _rotated(cloud, mode.rotation)
    column = column_size(surface, cloud.settings)
    surface = _in_columns(surface, column, mode.margins)
    maps, surface = _fit_revolutions(surface, cloud, mode, corner, column)
    header, levels = _plan_octree(surface, cloud.settings, column)
    header = _place(header, cloud, mode, corner, column)
    header = header._replace(revolutions=b"".join(pack_parameters(each.surface) for each in maps))
    if not is_decodable(header):
        return None
    coded = _code_patches(header, levels, surface, maps, cloud, column)
    if coded is None:
        return None
    patches, bits = coded
    density = _density(patches, len(cloud.points), column)
    if density is None:
        return None
    header = header._replace(points_across=density[0], column_spacing=density[1])
    return CodedSurface(pack_surface(header, bits), patches._replace(header=header))


def _code_patches(
    header: SurfaceHeader,
    levels: list[Level],
    surface: SurfaceSamples,
    maps: list[UnrolledMap],
    cloud: PreparedCloud,
    column: float,
) -> tuple[Patches, bytes] | None:
    """Decide and code octree, planes and occupancy maps: what a decoder reads, and the bytes.

    None where they are more than a decoder takes.
    """
    points, lmbda = len(cloud.points), _lambda_in_columns(cloud, column)
    geometry = octree_geometry(header, lmbda)
    levels_of_leaves = (header.coarsest_leaf_level, header.finest_leaf_level)
    prune_octree(levels, lmbda, _LEAF_BITS, _SPLIT_BITS, *levels_of_leaves)
    noise = (cloud.noise / column) ** 2
    lmbda_of_maps = max(lmbda, _MIN_LAMBDA_NOISE * noise / points)
    limits = MergeLimits(_REGION_BITS * lmbda_of_maps, _REGION_NOISE * noise, _MIN_REGION_COSINE)
    map_columns = sum(len(each.bits) for each in maps)
    node_bytes = _BYTES_PER_NODE + 2 * 4 ** (header.depth - header.finest_leaf_level)
    max_bytes = 4096 + node_bytes * header.leaf_capacity + map_columns // 4
    coder = writer(CONTEXTS, MIXERS, max_bytes)
    leaves, leaf_map, occupancy = empty_arrays(header)
    nodes = _nodes(levels, geometry.shape, limits)
    whole = code_octree(coder, geometry, nodes, leaves, leaf_map)
    if not whole or columns_of(leaves) > MAX_COLUMNS:
        return None
    criterion = _criterion(surface, lmbda_of_maps, column)
    code_occupancy_maps(coder, geometry, leaves, leaf_map, criterion, occupancy)
    for each in maps:
        code_unrolled_map(coder, each.surface.columns(), each.bits)
    decoded = unpack_parameters(header.revolutions)
    revolutions = list(zip(decoded, [each.bits for each in maps], strict=True))
    return Patches(header, geometry, leaves, occupancy, revolutions), written(coder.bits)


def _tolerance(cloud: PreparedCloud) -> float:
    return _TOLERANCE * cloud.settings.column_size + _TOLERANCE_NOISE * cloud.noise


def _lambda_in_columns(cloud: PreparedCloud, column: float) -> float:
    """Lagrangian weight of a bit, for squared distances in columns averaged over the points."""
    return cloud.settings.lmbda / column**2 / len(cloud.points)


def _omission_error(column: float) -> float:
    return max(_OMISSION_ERROR / column**2, _MIN_OMISSION_ERROR)


def _rotated(cloud: PreparedCloud, rotation: RotationVector) -> tuple[SurfaceSamples, Floats]:
    """The surface along other axes, from its corner on, and that corner (3,) in units."""
    surface, matrix = cloud.surface, rotation_matrix(rotation)
    xyz = rotated(surface.xyz, matrix)
    corner = xyz.min(axis=0)
    return surface._replace(xyz=xyz - corner, normals=rotated(surface.normals, matrix)), corner


def _in_columns(
    surface: SurfaceSamples, column: float, margins: tuple[float, float, float]
) -> SurfaceSamples:
    """The surface in columns of the grid."""
    xyz = surface.xyz / column + margins
    return surface._replace(xyz=np.maximum(xyz, 0.0), spacing=surface.spacing / column)


def _fit_revolutions(
    surface: SurfaceSamples, cloud: PreparedCloud, mode: SurfaceMode, corner: Floats, column: float
) -> tuple[list[UnrolledMap], SurfaceSamples]:
    """Occupancy maps of the surfaces of revolution, and the samples that are left to planes."""
    if not mode.revolutions:
        return [], surface
    matrix = rotation_matrix(mode.rotation)
    placed = [to_grid(each, matrix, corner, column, mode.margins) for each in mode.revolutions]
    lmbda = _lambda_in_columns(cloud, column)
    costs = RevolutionCosts(
        omission_error=_omission_error(column),
        tangential_weight=_TANGENTIAL_WEIGHT,
        max_error=_MAX_ERROR / column**2,
        tolerance=_tolerance(cloud) / column,
        spacing=surface.spacing,
        edge_cost=_EDGE_BITS * lmbda * surface.spacing**2 / (surface.area / 2),
    )
    weights = surface.shares / surface.area
    maps, unexplained = fit_revolutions(placed, surface.xyz, surface.normals, weights, costs)
    unexplained[:: -(-len(unexplained) // _MIN_PLANE_SAMPLES)] = True
    return maps, surface.only(unexplained)


def _plan_octree(
    surface: SurfaceSamples, settings: Settings, column: float
) -> tuple[SurfaceHeader, list[Level]]:
    """The octree's levels, and a header without place, density and surfaces of revolution."""
    shape = np.floor(surface.xyz.max(axis=0)).astype(np.int64) + 1
    depth = (int(shape.max()) - 1).bit_length()
    finest = max(depth - round(np.log2(max(settings.min_leaf_size / column, 1))), 0)
    coarsest = max(depth - round(np.log2(max(settings.max_leaf_size / column, 1))), 0)
    weights = surface.shares / 2 + surface.area / 2
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
        plane_step=min(max(round(16 * settings.plane_step / column), 1), 255),
        points_across=1,
        column_spacing=1,
        leaf_capacity=len(levels[finest].cells) + 8,
    )
    return header, levels


def _place(
    header: SurfaceHeader, cloud: PreparedCloud, mode: SurfaceMode, corner: Floats, column: float
) -> SurfaceHeader:
    """The header with the place of the grid in the input's coordinates."""
    start = corner - np.array(mode.margins) * column
    corner_there = rotated(cloud.corner[None], rotation_matrix(mode.rotation))[0]
    origin = corner_there + cloud.unit * start
    return header._replace(origin=origin, cell_size=column * cloud.unit, rotation=mode.rotation)


def _nodes(levels: list[Level], shape: Ints, limits: MergeLimits) -> Nodes:
    """The levels in one list, and the regions of their leaves; shape: (3,) cells of the grid."""
    moments = np.concatenate([level.moments for level in levels])
    places, leaves = leaves_of(levels)
    regions = np.zeros_like(moments)
    regions[places] = region_moments(moments[places], leaves, shape, limits)
    starts = np.cumsum([0] + [len(level.cells) for level in levels])
    first_child = [
        level.first_child[:-1] + start for level, start in zip(levels, starts[1:], strict=True)
    ]
    cells = np.concatenate([level.cells for level in levels]) & 1
    return Nodes(
        moments,
        np.concatenate([*first_child, starts[-1:]]),
        np.concatenate([level.is_leaf for level in levels]),
        cells @ np.array([4, 2, 1]),
        regions,
    )


def _criterion(surface: SurfaceSamples, lmbda: float, column: float) -> RdCriterion:
    cells = np.floor(surface.xyz / surface.spacing).astype(np.int64)
    sample_at = np.zeros(cells.max(axis=0) + 1, np.int32)
    sample_at[tuple(cells.T)] = np.arange(1, len(cells) + 1)
    return RdCriterion(
        surface.xyz,
        surface.normals,
        surface.shares / 2,
        sample_at,
        spacing=surface.spacing,
        tangential_weight=_TANGENTIAL_WEIGHT,
        max_error=_MAX_ERROR / column**2,
        omission_error=_omission_error(column),
        area_weight=surface.area / 2,
        edge_cost=_EDGE_BITS * lmbda,
    )


def _density(patches: Patches, max_points: int, column: float) -> tuple[int, int] | None:
    """Points across a column and columns between points, of the densest grid within `max_points`.

    None if there is no such grid, or the surface is empty.
    """
    arrays = (patches.geometry, patches.leaves, patches.occupancy)
    revolution_columns = sum(int(bits.sum()) for _, bits in patches.revolutions)
    max_points = min(max_points, MAX_POINTS)
    across, spacing = min(max(round(column / _POINT_SPACING), 1), _MAX_POINTS_ACROSS), 1
    columns = count_points(*arrays, 1, 1)
    while True:
        points = columns * across**2 if spacing == 1 else count_points(*arrays, 1, spacing)
        of_revolutions = revolution_columns * across**2
        points += of_revolutions // spacing**2
        if points <= max_points and of_revolutions <= MAX_REVOLUTION_POINTS:
            return (across, spacing) if points else None
        if across > 1:
            across -= 1
        elif spacing < _MAX_COLUMN_SPACING:
            spacing += 1
        else:
            return None
