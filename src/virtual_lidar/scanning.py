from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh, check_mesh
from pointkit.lidar.sensor import Sensor
from pointkit.threads import allowed_threads
from virtual_lidar.errors.model import Draws, ErrorModel, Hits
from virtual_lidar.errors.receiver import Received
from virtual_lidar.placement import check_free, check_untouched
from virtual_lidar.raycast import Cast, RayCaster, distinct, follow_mirrors
from virtual_lidar.scan_table import COLUMNS, ScanTable
from virtual_lidar.sweep import Rays, Sweep

Progress = Callable[[int, int], None]
"""Function that is called with the number of scanned frames and the number of all frames."""

Result = TypeVar("Result")

# Calls that wait for a thread or for the error model: so few take little memory.
_CALLS_AHEAD = 2
# Rays that are cast at a time: enough for the fixed costs of a block (2 ms), few enough for memory.
_RAYS_AT_A_TIME = 1 << 18
# Rows of a portion of a streamed scan, and thus of a row group of its file: some 140 MB.
_RAYS_IN_A_PORTION = 1 << 20


@dataclass(frozen=True)
class ScanJob:
    """A virtual scan whose input can be checked in advance, and whose result can come in portions.

    Use the function `scan` for a scan that fits in memory and needs neither.

    Parameters
    ----------
    mesh, sensor, sweep, model, origin
        The same as in `scan`.
    anywhere
        Whether to accept any path of the sensor. If false, `check` and the scan raise InputError if
        the sensor starts outside of the scene or inside an object, or if it moves through a
        surface.
    threads
        Number of threads that cast rays and write the table; 0 means one per processor. It changes
        speed, not the result.
    """

    mesh: Mesh
    sensor: Sensor
    sweep: Sweep
    model: ErrorModel
    origin: Floats | Sequence[float]
    anywhere: bool = True
    threads: int = 0

    @property
    def rays(self) -> int:
        """Number of rays that the sensor fires during the scan, with and without a hit."""
        return self.sweep.frames * self.sweep.steps(self.sensor) * self.sensor.lasers

    def table(
        self,
        rng: np.random.Generator,
        progress: Progress | None = None,
        rays_at_a_time: int = _RAYS_AT_A_TIME,
    ) -> ScanTable:
        """Make the scan and return all of it as one table, as `scan` does.

        Parameters
        ----------
        rng, progress
            The same as in `scan`.
        rays_at_a_time
            Number of rays that are cast together. It changes memory and speed, not the result.
        """
        (table,) = self.portions(rng, progress, self.rays, rays_at_a_time)
        return table

    def portions(
        self,
        rng: np.random.Generator,
        progress: Progress | None = None,
        rays_in_a_portion: int = _RAYS_IN_A_PORTION,
        rays_at_a_time: int = _RAYS_AT_A_TIME,
    ) -> Iterator[ScanTable]:
        """Make the scan frame by frame and yield it as several tables, which saves memory.

        Parameters
        ----------
        rng, progress
            The same as in `scan`.
        rays_in_a_portion
            Greatest number of rays that one table covers. A table has at least one frame, even if
            this frame has more rays.
        rays_at_a_time
            Number of rays that are cast together. It changes memory and speed, not the result.

        Yields
        ------
        ScanTable
            The returns of successive frames. Portions without a return are not yielded.

        Raises
        ------
        InputError
            The mesh or the sensor's position is invalid. If no ray of the whole scan has returned,
            the error is raised at the end.
        """
        scanner, rows = _Scanner(self._caster(), self.sensor, self.sweep, self.model, Draws(rng)), 0
        rays_per_frame = self.rays // self.sweep.frames
        for frames in _portions(range(self.sweep.frames), rays_in_a_portion // rays_per_frame):
            blocks = _portions(frames, rays_at_a_time // rays_per_frame)
            table = scanner.table(blocks, len(frames) * rays_per_frame, progress)
            rows += len(table)
            if len(table):
                yield table
        if rows == 0:
            place = scanner.caster.origin.tolist()
            raise InputError(f"no ray returned to a sensor at {place}: is it inside the scene?")

    def check(self) -> None:
        """Raise InputError if the mesh is invalid, or the sensor's position or path in it."""
        self._caster()

    def _caster(self) -> RayCaster:
        check_mesh(self.mesh, "the mesh to scan")
        caster = RayCaster(self.mesh, _checked_origin(self.origin), self.threads)
        times, places = self.sweep.way()
        check_untouched(caster, places)
        if not self.anywhere:
            check_free(caster, times, places)
        return caster


def scan(
    mesh: Mesh,
    sensor: Sensor,
    sweep: Sweep,
    model: ErrorModel,
    origin: Floats | Sequence[float],
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> ScanTable:
    """Scan a mesh with a virtual spinning LiDAR (thesis, section 5.2).

    A *nominal* ray has the direction that the sensor reports. If the error model fires a ray in
    another direction (beam divergence), the sensor measures the distance along the fired ray. The
    ray then has a return only if both rays hit a surface within the sensor's range.

    Parameters
    ----------
    mesh
        The scene, in metres, with z up.
    sensor
        Description of the sensor, from `load_sensor`.
    sweep
        How the sensor rotates and moves during the scan, from `open_sweep`.
    model
        The sensor's measurement errors, from `open_error_model`.
    origin
        Position of the sensor, (3,), m. If the sweep has a trajectory, its positions are relative
        to this point. `free_origin` finds a suitable position.
    rng
        Generator that seeds all random numbers of the error model.
    progress
        Function that is called with the number of frames that are done and the number of all
        frames.

    Returns
    -------
    ScanTable
        One row for each nominal ray with a return, in the order of firing (by frame, azimuth step
        and laser). The columns ``distance``, ``x``, ``y`` and ``z`` are true values: where the
        nominal ray hits the mesh. The columns ``distance_noisy``, ``x_noisy``, ``y_noisy`` and
        ``z_noisy`` are the measured values.

    Raises
    ------
    InputError
        The mesh has no faces, the origin is invalid or within 1 mm of the mesh, or no ray returned.
    """
    return ScanJob(mesh, sensor, sweep, model, origin).table(rng, progress)


@dataclass(frozen=True)
class _CastBlock:
    """Nominal rays of some frames, and what they and the fired rays hit."""

    frames: range
    nominal: Rays
    truth: Cast
    hits: Hits
    placed: Floats


@dataclass(frozen=True)
class _Returns:
    """Which rays of a block have returned, and what is measured for each ray."""

    returned: NDArray[np.bool_]
    count: int
    distance: Floats
    lift: Floats | None


def _check_shape(values: np.broadcast | Floats, expected: Floats) -> None:
    """Raise InputError if an error model's values have another shape than they have to."""
    if values.shape != expected.shape:
        raise InputError(f"the error model returned {values.shape} for {expected.shape} values")


@dataclass(frozen=True)
class _Scanner:
    caster: RayCaster
    sensor: Sensor
    sweep: Sweep
    model: ErrorModel
    draws: Draws

    @cached_property
    def about(self) -> dict[str, Any]:
        about = {
            "sensor": self.sensor.model_dump(),
            "sweep": self.sweep.model_dump(),
            "errors": self.model.described(),
            "origin": self.caster.origin.tolist(),
        }
        # With lists instead of tuples, as read from a file.
        as_read: dict[str, Any] = json.loads(json.dumps(about))
        return as_read

    def table(self, blocks: list[range], rays: int, progress: Progress | None) -> ScanTable:
        """Scan the frames of successive blocks, which have at most `rays` returns.

        Threads cast the rays and write the table. The error model is called here, in an order that
        does not depend on the number of threads.
        """
        columns = {name: np.empty(rays, dtype=kind) for name, (kind, *_) in COLUMNS.items()}
        rows = 0

        def measured(casts: Iterator[_CastBlock]) -> Iterator[Callable[[], range]]:
            nonlocal rows
            for block in casts:
                returns, first = self._measured(block), rows
                rows += returns.count
                part = tuple(column[first:rows] for column in columns.values())
                yield partial(self._write, block, returns, part)

        with ThreadPoolExecutor(self.caster.threads or allowed_threads()) as pool:
            casts = _called_ahead(pool, map(self._fired, blocks))
            for frames in _called_ahead(pool, measured(casts)):
                if progress is not None:
                    progress(frames.stop, self.sweep.frames)
        return ScanTable({name: column[:rows] for name, column in columns.items()}, self.about)

    def _fired(self, frames: range) -> Callable[[], _CastBlock]:
        nominal = self.sweep.rays(self.sensor, frames)
        fired = self.model.perturb_rays(nominal, self.sensor, self.draws)
        _check_shape(np.broadcast(fired.yaw, fired.pitch), fired.yaw)
        return partial(self._cast, frames, nominal, fired)

    def _cast(self, frames: range, nominal: Rays, fired: Rays) -> _CastBlock:
        poses = self.sweep.poses(self.sensor, frames)
        truth = self.caster.cast(nominal, poses, self._limits)
        measured = truth if fired is nominal else self.caster.cast(fired, poses, self._limits)
        if self.mirrors is not None:
            measured = follow_mirrors(self.caster, measured, self.mirrors, self._limits[1])
        placed = measured.directions if fired.placed_as_fired else truth.directions
        return _CastBlock(frames, nominal, truth, measured.hits, placed)

    def _measured(self, block: _CastBlock) -> _Returns:
        hits = self.model.merge_hits(block.hits, self.sensor)
        distance = self.model.perturb_ranges(hits, self.sensor, self.draws)
        lift = self.model.lift_points(hits, self.sensor, self.draws)
        for values in (distance, hits.distance if lift is None else lift):
            _check_shape(values, block.truth.hits.distance)
        returned = np.isfinite(distance) & np.isfinite(block.truth.hits.distance)
        return _Returns(returned, int(np.count_nonzero(returned)), distance, lift)

    def _write(
        self, block: _CastBlock, returns: _Returns, columns: tuple[NDArray[Any], ...]
    ) -> range:
        from virtual_lidar.kernels import MeasuredRays, TrueRays, fill_returns

        hits, nominal = block.truth.hits, block.nominal
        true = TrueRays(
            distinct(self.sweep.firing_times(self.sensor, block.frames)),
            distinct(nominal.yaw),
            distinct(nominal.pitch),
            block.truth.origins,
            block.truth.directions,
            hits.distance.ravel(),
            hits.triangle.ravel(),
            hits.incidence.ravel(),
        )
        lifts = () if returns.lift is None else returns.lift
        measured = MeasuredRays(block.placed, *map(_flat, (returns.distance, lifts)))
        surface = self.caster.planes, self.caster.object_id, self.caster.primitive_id
        fill_returns(returns.returned, block.frames.start, true, measured, surface, columns)
        return block.frames

    @cached_property
    def mirrors(self) -> NDArray[np.bool_] | None:
        if not isinstance(self.model, Received):
            return None
        return self.model.receiver.mirrored(self.caster.surfaces)

    @property
    def _limits(self) -> tuple[float, float]:
        return self.sensor.min_range_m, self.sweep.max_range_m or self.sensor.max_range_m


def _checked_origin(origin: Floats | Sequence[float]) -> Floats:
    try:
        place = np.asarray(origin, dtype=np.float64)
    except (TypeError, ValueError):
        place = np.empty(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError(f"the sensor's origin is {origin}, but must be three finite numbers")
    return place


def _flat(values: Any) -> Floats:
    return np.ravel(np.asarray(values, dtype=np.float64))


def _called_ahead(pool: Executor, calls: Iterable[Callable[[], Result]]) -> Iterator[Result]:
    """Make calls in the threads of a pool, a few at once, and yield their results in order."""
    begun: deque[Future[Result]] = deque()
    for call in calls:
        begun.append(pool.submit(call))
        if len(begun) > _CALLS_AHEAD:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()


def _portions(frames: range, at_a_time: int) -> list[range]:
    step = max(at_a_time, 1)
    return [frames[first : first + step] for first in range(0, len(frames), step)]
