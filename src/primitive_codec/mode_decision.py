"""Mode decision: the encoder tries several ways to code a cloud, and keeps the best.

Surfaces are encoded on grids along the axes of the cloud and of its Manhattan frame, with and
without each detected surface of revolution. The surface with the least distortion + lambda * rate
is then compared with voxels that take as many bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from hashlib import sha256
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from pointkit.geometry.cloud import Floats, bounds
from pointkit.measurement import CostlyResult
from pointkit.threads import few_at_once, in_threads
from primitive_codec import hybrid_mode, voxel_mode
from primitive_codec.decoder import Patches, count_surface_points, reconstruct_surface
from primitive_codec.distortion import Distortion, NearestOffsets, subsample
from primitive_codec.manhattan_frame import estimate_manhattan_frame
from primitive_codec.preparation import PreparedCloud, axis_aligned_column_size, prepare
from primitive_codec.revolution import RevolutionSurface
from primitive_codec.settings import UNITS, PrimitiveSettings
from primitive_codec.stream import MAX_POINT_SPACING
from primitive_codec.surface_mode import (
    CodedSurface,
    SurfaceMode,
    encode_surface,
    point_corner_offset,
    revolution_candidates,
)
from primitive_codec.voxel_mode import CodedVoxels, VoxelSearch

_LAMBDA_FACTORS = (2.0, 4.0)
"""Factors of lambda for coarser surfaces, tried if voxels are better than the surface.

With many bytes, voxels reproduce noise and scattered points; with fewer, a surface may be
better."""
_HYBRID_LAMBDA_FACTORS = (8.0, 16.0, 32.0)
"""Factors of lambda for still coarser surfaces in hybrids."""
_SPARSENESS = 2
"""Factor of the points' spacing when surfaces are compared."""
_MAX_REJECTED = 3
"""Number of consecutively rejected surfaces of revolution after which the search ends."""
_MIN_COST_RATIO = 0.98
"""Cost ratio below which a grid offset replaces the current one; smaller gains may be chance."""
_DIAGONAL_OFFSETS = (0.25, 0.75, 1.25, 1.75)
"""Candidate offsets of the grid, in columns, equal along all axes.

Walls between nodes, or through many corners of nodes, cost more than walls through their middle.
Leaves are at least two columns wide."""
_AXIS_OFFSETS = (-0.5, 0.5)
_MIN_ALIGNED_LEAF_SIZE = 12.0
"""Side of the smallest leaves, in units, below which offsets make no difference."""
_REFINEMENT_DEFAULTS = {
    name: PrimitiveSettings.model_fields[name].default
    for name in ("refinement", "refined_bpp", "max_voxel_size")
}
_POINT_TOLERANCE, _MAX_POINT_RATIO = 1.05, 1.25
"""Limits of a chosen surface's point-to-point error, as multiples of the error of undisplaced
voxels: first if single errors are compared, then if products of errors are compared. The error of a
surface is never zero, because the positions of points on it are not coded."""


def encode(points: Floats, settings: PrimitiveSettings, cache: SurfaceCache | None = None) -> bytes:
    """Encode a cloud as surfaces, as voxels, or as both, whichever costs least.

    Parameters
    ----------
    points
        Coordinates (n, 3), n > 0, finite, in any unit.
    settings
        The rate. Its lengths are in units of 1/1023 of the cloud's longest side. `RATES` holds
        eight suitable sets of values.
    cache
        Object that is passed to all calls for the same cloud. Rates that differ only in their
        refinement then share the search for the surface, which saves time. It does not change
        streams.

    Returns
    -------
    bytes
        A stream that `decode`, `decode_surface` and `decode_mesh` read without further data.
    """
    low, high = bounds(points)
    if (low == high).all():
        return voxel_mode.encode_voxels_of_size(points, 1.0)
    if settings.min_leaf_size == 0:
        search, budget = VoxelSearch(points), _max_bytes(points, settings)
        return search.encode_to_budget(budget, settings.max_voxel_size).stream
    result = (cache or SurfaceCache()).search(points, settings)
    return _encode_refined(result, settings) if settings.refinement else result.selection.stream


def _max_bytes(points: Floats, settings: PrimitiveSettings) -> int:
    return int(settings.max_bpp * len(points) / 8)


class _Candidate(NamedTuple):
    cost: float
    mode: SurfaceMode
    coded: CodedSurface | None  # None if the mode cannot be coded


class _Selection(NamedTuple):
    stream: bytes
    surface: CodedSurface | None  # None if the stream holds voxels


class _SearchResult(NamedTuple):
    cloud: PreparedCloud
    best: _Candidate  # the surface of least cost
    selection: _Selection  # the mode selected without refinement
    trials: tuple[voxel_mode.Trial, ...]


class SurfaceCache(CostlyResult[_SearchResult]):
    """Keeps the surface of the last encoded cloud, so that other rates can reuse it.

    Only rates with refinement reuse the surface. A rate without refinement repeats the search, so
    that its time can be measured. `saved` is the cost of the work that the last call did not
    repeat.
    """

    def search(self, points: Floats, settings: PrimitiveSettings) -> _SearchResult:
        """Return the best surface of a cloud, from the cache if the settings allow it."""
        unrefined = settings.model_copy(update=_REFINEMENT_DEFAULTS)
        key = sha256(points.tobytes()).digest(), unrefined
        return self.of(key, partial(_search, points, unrefined), reuse=settings.refinement > 0)


def _search(points: Floats, settings: PrimitiveSettings) -> _SearchResult:
    cloud = prepare(points, settings)
    best = _best_surface(cloud)
    search = VoxelSearch(cloud.source)
    selection = _select_mode(cloud, best, _max_bytes(points, settings), search)
    return _SearchResult(cloud, best, selection, tuple(search.trials))


def _select_mode(
    cloud: PreparedCloud, best: _Candidate, max_bytes: int, search: VoxelSearch
) -> _Selection:
    """Select the finest surface that is better than voxels of as many bytes."""
    # If no surface is better, the product of the errors (see `Distortion`) decides between voxels
    # and the coarsest surface, then between voxels and a hybrid.
    if best.coded is None:
        return _Selection(search.encode_to_budget(max_bytes).stream, None)
    voxels: list[CodedVoxels] = []
    coarsest, comparison = _Selection(b"", None), None
    for coded in chain([best.coded], _encode_with_lambdas(cloud, best.mode, _LAMBDA_FACTORS)):
        fits = coded is not None and len(coded.stream) <= max_bytes
        budget = len(coded.stream) if coded and fits else max_bytes
        voxels.append(search.encode_to_budget(budget))
        if coded and fits:
            coarsest = _Selection(coded.stream, coded)
            comparison = _Comparison.of(cloud, coded.decoded().xyz, voxels[-1])
            if comparison.surface_is_better():
                return coarsest
    if comparison is not None and comparison.surface_is_better_by_product():
        return coarsest
    hybrid = _encode_coarse_hybrid(cloud, coded, best.mode, voxels[0], search)
    return _Selection(hybrid or voxels[0].stream, None)


def _encode_coarse_hybrid(
    cloud: PreparedCloud,
    coded: CodedSurface | None,
    mode: SurfaceMode,
    voxels: CodedVoxels,
    search: VoxelSearch,
) -> bytes | None:
    """Return the best hybrid that fits into the bytes of `voxels`, or None if voxels are better."""
    # Surfaces coarser than `coded` are tried while they improve the hybrid.
    criterion = _hybrid_criterion(cloud, 0.0)
    voxel_cost = criterion.cost(cloud.distortion(voxels.points))
    coarser = _encode_with_lambdas(cloud, mode, _HYBRID_LAMBDA_FACTORS)
    best, least, max_bytes = None, np.inf, len(voxels.stream)
    for surface in chain([coded], coarser):
        if surface is None:
            break
        if not hybrid_mode.has_voxel_budget(surface.stream, max_bytes):
            continue
        hybrid = hybrid_mode.encode(search, surface, max_bytes, UNITS / 4, criterion)
        if hybrid is None or hybrid.cost >= least:
            break
        best, least = hybrid.stream, hybrid.cost
    return best if least < voxel_cost else None


def _hybrid_criterion(cloud: PreparedCloud, refinement: float) -> hybrid_mode.HybridCriterion:
    # Its cost is a product of errors, ``point * plane * surface ** (1 - refinement)``: those to the
    # points, to their planes, and to the smoothed surface. `refinement` is from 0 to 1.

    def nearest_offsets(decoded: Floats) -> NearestOffsets:
        return cloud.estimator.nearest_offsets(cloud.in_units(decoded))

    def measure(decoded: Floats, offsets: NearestOffsets) -> Distortion:
        return cloud.estimator.measure(cloud.in_units(subsample(decoded)), offsets)

    def cost(errors: Distortion) -> float:
        return float(errors.point * errors.plane * errors.surface ** (1 - refinement))

    return hybrid_mode.HybridCriterion(nearest_offsets, measure, cost)


def _encode_refined(result: _SearchResult, settings: PrimitiveSettings) -> bytes:
    """Encode a hybrid, or voxels if voxels of as many bytes are better."""
    # If a surface was selected without refinement, `_voxels_lose_surface` decides; otherwise cost.
    cloud, best, selection, trials = result
    search = VoxelSearch(cloud.source, trials)
    max_bytes, max_voxel_size = _refined_budget(search, len(selection.stream), settings)
    refined = selection
    if selection.surface is None and best.coded:
        refined = _Selection(best.coded.stream, best.coded)
    if refined.surface:
        criterion = _hybrid_criterion(cloud, settings.refinement)
        hybrid = hybrid_mode.encode(search, refined.surface, max_bytes, max_voxel_size, criterion)
        if hybrid:
            voxels = search.encode_to_budget(len(hybrid.stream), max_voxel_size)
            voxel_errors = cloud.distortion(voxels.points)
            loses_surface = _voxels_lose_surface(voxel_errors, hybrid.distortion, settings)
            is_cheaper = hybrid.cost <= criterion.cost(voxel_errors)
            if loses_surface if selection.surface else is_cheaper:
                return hybrid.stream
    return search.encode_to_budget(max_bytes, max_voxel_size).stream


def _voxels_lose_surface(
    voxels: Distortion, hybrid: Distortion, settings: PrimitiveSettings
) -> bool:
    """Return whether voxels lose more surface accuracy than they gain point accuracy."""
    # They do if their point or plane error is not less than the hybrid's, or if ``point * plane *
    # surface ** (6 * (1 - refinement))`` is at least 1, where each factor is the voxels' error
    # divided by the hybrid's.
    if voxels.point >= hybrid.point or voxels.plane >= hybrid.plane:
        return True
    gain = voxels.point * voxels.plane / (hybrid.point * hybrid.plane)
    loss = voxels.surface / hybrid.surface
    return bool(gain * loss ** (6 * (1 - settings.refinement)) >= 1)


def _refined_budget(
    search: VoxelSearch, selected_bytes: int, settings: PrimitiveSettings
) -> tuple[int, float]:
    """Return how many bytes a hybrid may take, and the largest side of its voxels in units."""
    # The budget grows exponentially with the refinement. At refinement 1 voxels are at most
    # `max_voxel_size`, even if they need more than `refined_bpp`.
    low, high = bounds(search.points)
    unit = float((high - low).max()) / UNITS
    voxel_bytes = search.byte_count_at(settings.max_voxel_size * unit)
    budget = max(int(settings.refined_bpp * len(search.points) / 8), selected_bytes)
    if settings.refinement == 1:
        return max(budget, voxel_bytes), settings.max_voxel_size
    ratio = max(budget, voxel_bytes + selected_bytes) / selected_bytes
    return int(selected_bytes * ratio**settings.refinement), UNITS / 4


def _encode_with_lambdas(
    cloud: PreparedCloud, mode: SurfaceMode, factors: Sequence[float]
) -> Iterator[CodedSurface | None]:
    def encode_with(factor: float) -> CodedSurface | None:
        weighted = cloud.settings.model_copy(update={"lmbda": factor * cloud.settings.lmbda})
        return encode_surface(cloud._replace(settings=weighted), mode)

    return few_at_once(encode_with, factors)


def _best_surface(cloud: PreparedCloud) -> _Candidate:
    searches: list[Callable[[], Any]] = [
        partial(_best_grid, cloud),
        partial(revolution_candidates, cloud),
    ]
    best, detected = in_threads(lambda search: search(), searches)
    return _add_revolutions(cloud, best, list(detected))


def _add_revolutions(
    cloud: PreparedCloud, best: _Candidate, remaining: list[RevolutionSurface]
) -> _Candidate:
    rejected = 0
    while remaining and rejected < _MAX_REJECTED:
        # Candidates of one batch are coded in parallel. After an accepted one the others are coded
        # again, together with it.
        batch = remaining[: _MAX_REJECTED - rejected]
        revolutions = best.mode.revolutions
        modes = [best.mode._replace(revolutions=(*revolutions, surface)) for surface in batch]
        for candidate in few_at_once(partial(_evaluate, cloud), modes):
            remaining.pop(0)
            if candidate.cost < best.cost:
                best, rejected = candidate, 0
                break
            rejected += 1
    return best


def _best_grid(cloud: PreparedCloud) -> _Candidate:
    best = _best_of(cloud, frame_candidates(cloud), None)
    leaf_size = max(cloud.settings.min_leaf_size, 2 * axis_aligned_column_size(cloud))
    if leaf_size < _MIN_ALIGNED_LEAF_SIZE:
        return best
    modes = [best.mode._replace(grid_offset=(k, k, k)) for k in _DIAGONAL_OFFSETS]
    best = _best_of(cloud, modes, best)
    for axis in range(3):
        modes = []
        for step in _AXIS_OFFSETS:
            x, y, z = (best.mode.grid_offset + step * np.eye(3)[axis]).tolist()
            if min(x, y, z) >= 0:
                modes.append(best.mode._replace(grid_offset=(x, y, z)))
        best = _best_of(cloud, modes, best)
    return best


def frame_candidates(cloud: PreparedCloud) -> list[SurfaceMode]:
    """Return the placements of the octree's grid that the encoder tries.

    Two grids run along the axes of the cloud; one begins at the lowest corner of the points, the
    other at that of the surface. If the cloud has a Manhattan frame, a third grid runs along its
    axes.
    """
    rotation = estimate_manhattan_frame(cloud.surface.normals)
    modes = [SurfaceMode(grid_offset=point_corner_offset(cloud)), SurfaceMode()]
    return [*modes, SurfaceMode(rotation)] if any(rotation) else modes


def _best_of(
    cloud: PreparedCloud, modes: Iterable[SurfaceMode], current: _Candidate | None
) -> _Candidate:
    candidates = in_threads(partial(_evaluate, cloud), modes)
    best = min([*candidates, *([current] if current else [])], key=lambda candidate: candidate.cost)
    return best if current is None or best.cost < _MIN_COST_RATIO * current.cost else current


def _evaluate(cloud: PreparedCloud, mode: SurfaceMode) -> _Candidate:
    coded = encode_surface(cloud, mode)
    if coded is None:
        return _Candidate(np.inf, mode, None)
    error = cloud.estimator.surface_error(cloud.in_units(_decode_sparsely(coded.patches)))
    rate = 8 * len(coded.stream) / len(cloud.points)
    return _Candidate(error + cloud.settings.lmbda * rate, mode, coded)


def _decode_sparsely(patches: Patches) -> Floats:
    header = patches.header
    spacing = min(_SPARSENESS * header.point_spacing, MAX_POINT_SPACING)
    if count_surface_points(patches, spacing) == 0:
        spacing = header.point_spacing
    sparse = header._replace(point_spacing=spacing)
    return reconstruct_surface(patches._replace(header=sparse)).xyz


class _Comparison(NamedTuple):
    surface: Distortion
    voxels: Distortion  # of as many bytes as the surface
    undisplaced: Distortion  # the same voxels without displacements

    @classmethod
    def of(cls, cloud: PreparedCloud, surface: Floats, voxels: CodedVoxels) -> _Comparison:
        decoded = [surface, voxels.points]
        if voxels.displacements:
            decoded.append(voxels.undisplaced().points)
        errors = in_threads(cloud.distortion, decoded)
        return cls(errors[0], errors[1], errors[-1])

    def surface_is_better(self) -> bool:
        is_nearer = self.surface.surface <= self.voxels.surface
        is_nearer = is_nearer and self.surface.plane <= self.undisplaced.plane
        return is_nearer and self.surface.point <= _POINT_TOLERANCE * self.undisplaced.point

    def surface_is_better_by_product(self) -> bool:
        is_better = np.prod(self.surface) <= np.prod(self.voxels)
        return bool(is_better and self.surface.point <= _MAX_POINT_RATIO * self.undisplaced.point)
