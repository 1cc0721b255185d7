"""Mode decision: candidate modes of coding a cloud are coded, and the one of least cost is kept.

Surfaces are coded along the cloud's axes and along its walls', with and without each detected
surface of revolution; the cost is distortion + lambda * rate. The best is compared with voxels of
as many bytes. Distortion is measured against the smoothed surface, since a decode nearer to the
points than their noise reproduces the noise; but surfaces must also be as near to the points as
G-PCC's voxels are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from hashlib import sha256
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from puckbench.core.measurement import NO_COST, Cost, measured
from puckbench.core.threads import few_at_once, in_threads
from puckbench.geometry.cloud import Floats, bounds
from puckbench.primitives import hybrid_mode, voxel_mode
from puckbench.primitives.decoder import (
    DecodedSurface,
    Patches,
    points_and_normals,
)
from puckbench.primitives.distortion import (
    Distortion,
    DistortionEstimator,
    Nearest,
    subset,
)
from puckbench.primitives.grid_alignment import (
    frame_candidates,
    margin_candidates,
    shift_candidates,
)
from puckbench.primitives.preparation import PreparedCloud, prepare
from puckbench.primitives.settings import UNITS, Settings
from puckbench.primitives.surface_mode import (
    CodedSurface,
    SurfaceMode,
    detect_surfaces,
    encode_surface,
)
from puckbench.primitives.voxel_mode import CodedVoxels, VoxelSearch

_LAMBDA_FACTORS = (2.0, 4.0)
"""Multiples of the rate's lambda at which a surface is compared with voxels as well.

With many bits voxels come nearer to noise and to scattered points, and surfaces do not; a surface
of fewer bits may still be better than voxels of as few.
"""
_COARSER_FACTORS = (8.0, 16.0, 32.0)
"""Further multiples, of a surface that voxels stand beside because none alone is better."""
_MAX_REFUSED = 3
"""Surfaces of revolution in a row that cost more than they save, after which no more are tried."""
_MIN_SAVING = 0.98
"""Ratio of the costs below which the grid is moved: a smaller saving may be chance."""
_WITHOUT_REFINEMENT = {
    name: Settings.model_fields[name].default
    for name in ("refinement", "refined_bpp", "max_voxel_size")
}
_POINT_TOLERANCE, _MAX_POINT_RATIO = 1.05, 1.25
"""Squared distance of a surface to the points, as a multiple of undisplaced voxels'.

The position of points within the surface is not coded, and alone keeps them some distance off.
"""


def encode(points: Floats, settings: Settings, shared: SharedSurface | None = None) -> bytes:
    """Code a cloud as surfaces, as voxels, or as both, whichever costs less.

    Parameters
    ----------
    points
        (n, 3) finite coordinates, n > 0.
    settings
        Parameters of the rate.
    shared
        The surface that rates of this cloud have in common.

    Returns
    -------
    bytes
        A self-contained stream.
    """
    low, high = bounds(points)
    if (low == high).all():
        return voxel_mode.encode_voxel_size(points, 1.0)
    if settings.min_leaf_size == 0:
        search, budget = VoxelSearch(points), _max_bytes(points, settings)
        return search.to_budget(budget, settings.max_voxel_size).stream
    found = (shared or SharedSurface()).surfaces_of(points, settings)
    return _hybrid_or_voxels(found, settings) if settings.refinement else found.kept.stream


def _max_bytes(points: Floats, settings: Settings) -> int:
    return int(settings.max_bpp * len(points) / 8)


class SharedSurface:
    """The surface, which rates that differ in their refinement alone have in common.

    The first of them searches for it, and so does each rate without refinement, so that repeated
    calls of that one are timed whole.
    """

    def __init__(self) -> None:
        self._key: tuple[bytes, Settings] | None = None
        self._surfaces: _Surfaces
        self._cost: Cost
        self.saved = NO_COST

    def surfaces_of(self, points: Floats, settings: Settings) -> _Surfaces:
        """The surface of points (n, 3) by the settings, whatever their refinement."""
        key = sha256(points.tobytes()).digest(), settings.model_copy(update=_WITHOUT_REFINEMENT)
        if key == self._key and settings.refinement > 0:
            self.saved = self._cost
        else:
            search = measured(partial(_find_surfaces, points, key[1]))
            self._key, self._surfaces = key, search.result
            self._cost = Cost(search.seconds, search.peak_mib)
        return self._surfaces


def _find_surfaces(points: Floats, settings: Settings) -> _Surfaces:
    cloud = prepare(points, settings)
    estimator = DistortionEstimator.of(cloud.points, *cloud.surface[:3])
    best = _best_surface(cloud, estimator)
    search = VoxelSearch(cloud.source)
    kept = _surface_or_voxels(cloud, estimator, best, _max_bytes(points, settings), search)
    return _Surfaces(cloud, estimator, best, kept, tuple(search.tried))


class _Candidate(NamedTuple):
    """A candidate mode, its cost (distortion + lambda * rate), and what it is coded as."""

    cost: float
    mode: SurfaceMode
    coded: CodedSurface | None


class _Kept(NamedTuple):
    """A stream, and the surface that it holds unless it has voxels."""

    stream: bytes
    surface: DecodedSurface | None


class _Surfaces(NamedTuple):
    """A cloud, the surface of least cost, and what is kept of it without refinement.

    tried: voxels that the comparison with them has tried.
    """

    cloud: PreparedCloud
    estimator: DistortionEstimator
    best: _Candidate
    kept: _Kept
    tried: tuple[voxel_mode.Trial, ...]


def _surface_or_voxels(
    cloud: PreparedCloud,
    estimator: DistortionEstimator,
    best: _Candidate,
    max_bytes: int,
    search: VoxelSearch,
) -> _Kept:
    """The finest surface that is better than voxels of as many bytes in all respects; else voxels.

    Where the surface of fewest bytes is better in one respect and worse in another, the product of
    the errors decides, and so it does between voxels alone and voxels beside that surface.
    """
    if best.coded is None:
        return _Kept(search.to_budget(max_bytes).stream, None)
    voxels: list[CodedVoxels] = []
    smallest, comparison = _Kept(b"", None), None
    for coded in chain([best.coded], _coded_surfaces(cloud, best.mode, _LAMBDA_FACTORS)):
        fits = coded is not None and len(coded.stream) <= max_bytes
        budget = len(coded.stream) if coded and fits else max_bytes
        voxels.append(search.to_budget(budget))
        if coded and fits:
            decoded = coded.decoded()
            smallest = _Kept(coded.stream, decoded)
            comparison = _Comparison.of(cloud, estimator, decoded.xyz, voxels[-1])
            if comparison.surface_is_better():
                return smallest
    if comparison is not None and comparison.surface_is_better_by_product():
        return smallest
    hybrid = _better_hybrid(cloud, estimator, coded, best.mode, voxels[0], search)
    return _Kept(hybrid or voxels[0].stream, None)


def _better_hybrid(
    cloud: PreparedCloud,
    estimator: DistortionEstimator,
    coded: CodedSurface | None,
    mode: SurfaceMode,
    voxels: CodedVoxels,
    search: VoxelSearch,
) -> bytes | None:
    """Voxels beside a surface, where they are better than a stream of as many bytes of voxels.

    coded: the surface of fewest bytes of those that were compared. Coarser ones are tried, which
    leave more bytes for voxels, while that is better.
    """
    criterion = _criterion(cloud, estimator, 0.0)
    least = criterion.cost(estimator.measure(cloud.in_units(voxels.points)))
    coarser = _coded_surfaces(cloud, mode, _COARSER_FACTORS)
    best, found, max_bytes = None, np.inf, len(voxels.stream)
    for surface in chain([coded], coarser):
        if surface is None:
            break
        if not hybrid_mode.leaves_voxels(surface.stream, max_bytes):
            continue
        part = hybrid_mode.SurfacePart(surface.stream, *surface.decoded()[:2])
        hybrid = hybrid_mode.encode(search, part, max_bytes, UNITS / 4, criterion)
        if hybrid is None or hybrid.cost >= found:
            break
        best, found = hybrid.stream, hybrid.cost
    return best if found < least else None


def _criterion(
    cloud: PreparedCloud, estimator: DistortionEstimator, refinement: float
) -> hybrid_mode.Criterion:
    """The product of the errors; the more a surface is refined, the less that to it counts."""

    def nearest(decoded: Floats) -> Nearest:
        return estimator.nearest(cloud.in_units(decoded))

    def measured(decoded: Floats, near: Nearest) -> Distortion:
        return estimator.measure(cloud.in_units(subset(decoded)), near)

    def product(errors: Distortion) -> float:
        return float(errors.point * errors.plane * errors.surface ** (1 - refinement))

    return hybrid_mode.Criterion(nearest, measured, product)


def _hybrid_or_voxels(found: _Surfaces, settings: Settings) -> bytes:
    """The surface refined by voxels, or voxels of as many bytes.

    What is refined is the surface that would be kept without voxels, and voxels alone take its
    place only where they do not lose it: more bits shall not lose what it had. Where voxels were
    kept, the product of the errors decides.
    """
    cloud, estimator, best, kept, known = found
    search = VoxelSearch(cloud.source, known)
    max_bytes, max_voxel_size = _refined_budget(search, len(kept.stream), settings)
    surface = kept
    if kept.surface is None and best.coded:
        surface = _Kept(best.coded.stream, best.coded.decoded())
    if surface.surface:
        part = hybrid_mode.SurfacePart(surface.stream, *surface.surface[:2])
        criterion = _criterion(cloud, estimator, settings.refinement)
        hybrid = hybrid_mode.encode(search, part, max_bytes, max_voxel_size, criterion)
        if hybrid:
            equal = search.to_budget(len(hybrid.stream), max_voxel_size)
            voxels = estimator.measure(cloud.in_units(equal.points))
            beside_surface = _lose_the_surface(voxels, hybrid.distortion, settings)
            if beside_surface if kept.surface else hybrid.cost <= criterion.cost(voxels):
                return hybrid.stream
    return search.to_budget(max_bytes, max_voxel_size).stream


def _lose_the_surface(voxels: Distortion, hybrid: Distortion, settings: Settings) -> bool:
    """Whether voxels alone lose more of the surface under the noise than they gain.

    They do unless they are nearer to the points in both respects. Then the distance to the surface
    counts, twice as much as each of these at a refinement of 2/3, and not at all at 1.
    """
    if voxels.point >= hybrid.point or voxels.plane >= hybrid.plane:
        return True
    gain = voxels.point * voxels.plane / (hybrid.point * hybrid.plane)
    loss = voxels.surface / hybrid.surface
    return bool(gain * loss ** (6 * (1 - settings.refinement)) >= 1)


def _refined_budget(search: VoxelSearch, kept_bytes: int, settings: Settings) -> tuple[int, float]:
    """Bytes of the refinement of a stream of `kept_bytes`, and the largest side of its voxels.

    Sparse clouds need more bits than `refined_bpp` for voxels of that side, beside the surface; the
    rates below the highest lie between in equal ratios all the same, and may have larger voxels.
    """
    low, high = bounds(search.points)
    unit = float((high - low).max()) / UNITS
    coarsest = search.bytes_of(settings.max_voxel_size * unit)
    budget = max(int(settings.refined_bpp * len(search.points) / 8), kept_bytes)
    if settings.refinement == 1:
        return max(budget, coarsest), settings.max_voxel_size
    ratio = max(budget, coarsest + kept_bytes) / kept_bytes
    return int(kept_bytes * ratio**settings.refinement), UNITS / 4


def _coded_surfaces(
    cloud: PreparedCloud, mode: SurfaceMode, factors: Sequence[float]
) -> Iterator[CodedSurface | None]:
    """The surface with multiples of the rate's lambda."""

    def coded(factor: float) -> CodedSurface | None:
        weighted = cloud.settings.model_copy(update={"lmbda": factor * cloud.settings.lmbda})
        return encode_surface(cloud._replace(settings=weighted), mode)

    return few_at_once(coded, factors)


def _best_surface(cloud: PreparedCloud, estimator: DistortionEstimator) -> _Candidate:
    """The surface of least cost: the best grid, then surfaces of revolution while they save."""
    searches: list[Callable[[], Any]] = [
        partial(_best_grid, cloud, estimator),
        partial(detect_surfaces, cloud),
    ]
    grid, found = in_threads(lambda search: search(), searches)
    best: _Candidate = grid
    waiting, refused = list(found), 0
    while waiting and refused < _MAX_REFUSED:
        # Those after an accepted one are tried again, together with it.
        accepted, several = best.mode.revolutions, waiting[: _MAX_REFUSED - refused]
        modes = [best.mode._replace(revolutions=(*accepted, surface)) for surface in several]
        for candidate in few_at_once(partial(_evaluate, cloud, estimator), modes):
            waiting.pop(0)
            if candidate.cost < best.cost:
                best, refused = candidate, 0
                break
            refused += 1
    return best


def _best_grid(cloud: PreparedCloud, estimator: DistortionEstimator) -> _Candidate:
    """The best axes, then the best position of the grid along them."""
    best = _best_of(cloud, estimator, frame_candidates(cloud), None)
    best = _best_of(cloud, estimator, margin_candidates(cloud, best.mode), best)
    for axis in range(3):
        best = _best_of(cloud, estimator, shift_candidates(cloud, best.mode, axis), best)
    return best


def _best_of(
    cloud: PreparedCloud,
    estimator: DistortionEstimator,
    modes: Iterable[SurfaceMode],
    known: _Candidate | None,
) -> _Candidate:
    """The mode of least cost; a known candidate unless another one saves enough."""
    candidates = in_threads(partial(_evaluate, cloud, estimator), modes)
    best = min([*candidates, *([known] if known else [])], key=lambda candidate: candidate.cost)
    return best if known is None or best.cost < _MIN_SAVING * known.cost else known


def _evaluate(
    cloud: PreparedCloud, estimator: DistortionEstimator, mode: SurfaceMode
) -> _Candidate:
    """Code a mode; infinite cost where it makes no points."""
    coded = encode_surface(cloud, mode)
    if coded is None:
        return _Candidate(np.inf, mode, None)
    error = estimator.to_surface(cloud.in_units(_decoded_sparsely(coded.patches)))
    rate = 8 * len(coded.stream) / len(cloud.points)
    return _Candidate(error + cloud.settings.lmbda * rate, mode, coded)


def _decoded_sparsely(patches: Patches) -> Floats:
    """Fewer points of the surfaces than the decoder makes, for a quick estimate."""
    header = patches.header
    sparse = header._replace(points_across=max(header.points_across // 3, 1))
    return points_and_normals(patches._replace(header=sparse)).xyz


class _Comparison(NamedTuple):
    """Distortions of a surface, of voxels of as many bytes, and of these without displacement."""

    surface: Distortion
    voxels: Distortion
    undisplaced: Distortion

    @classmethod
    def of(
        cls,
        cloud: PreparedCloud,
        estimator: DistortionEstimator,
        surface: Floats,
        voxels: CodedVoxels,
    ) -> _Comparison:
        """Measure the points (n, 3) of a surface and those of voxels."""
        decoded = [surface, voxels.points, *([voxels.undisplaced().points] if voxels.table else [])]
        found = in_threads(lambda xyz: estimator.measure(cloud.in_units(xyz)), decoded)
        return cls(found[0], found[1], found[-1])

    def surface_is_better(self) -> bool:
        """Whether the surface is nearer to the smoothed samples and to the points."""
        nearer = self.surface.surface <= self.voxels.surface
        nearer = nearer and self.surface.plane <= self.undisplaced.plane
        return nearer and self.surface.point <= _POINT_TOLERANCE * self.undisplaced.point

    def surface_is_better_by_product(self) -> bool:
        """Whether the surface gains more in some errors than it loses in the others."""
        product = np.prod(self.surface) <= np.prod(self.voxels)
        return bool(product and self.surface.point <= _MAX_POINT_RATIO * self.undisplaced.point)
