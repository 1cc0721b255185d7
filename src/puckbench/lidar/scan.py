from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh, check_mesh
from puckbench.io.return_tables import empty_columns
from puckbench.lidar.errors.model import Draws, ErrorModel
from puckbench.lidar.errors.receiver import mirrors_of
from puckbench.lidar.mirrors import follow_mirrors
from puckbench.lidar.placement import check_free, check_untouched
from puckbench.lidar.raycast import Cast, RayCaster
from puckbench.lidar.scan_table import ScanTable, read_scan, write_scan
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays, Sweep

__all__ = ["ScanJob", "ScanTable", "read_scan", "scan", "write_scan"]

Progress = Callable[[int, int], None]
"""Receives the numbers of scanned and of all frames."""

# Rays that are cast at a time: enough for the ray caster's threads, few enough to stay in cache.
_RAYS_AT_A_TIME = 1 << 16
# Rows of a portion of a streamed scan, and thus of a row group of its file: some 140 MB.
_RAYS_IN_A_PORTION = 1 << 20


@dataclass(frozen=True)
class ScanJob:
    """A virtual scan of a mesh (m, z up) by a sensor at `origin` (3,).

    Unless `anywhere` is set, the sensor must be inside the scene and outside objects, and must not
    move through a surface.
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
        return self.sweep.frames * self.sweep.steps(self.sensor) * self.sensor.lasers

    def table(
        self,
        rng: np.random.Generator,
        progress: Progress | None = None,
        rays_at_a_time: int = _RAYS_AT_A_TIME,
    ) -> ScanTable:
        scanner = self._scanner(rng)
        table = scanner.table(range(self.sweep.frames), rays_at_a_time, progress)
        if len(table) == 0:
            raise scanner.no_return()
        return table

    def portions(
        self,
        rng: np.random.Generator,
        progress: Progress | None = None,
        rays_in_a_portion: int = _RAYS_IN_A_PORTION,
    ) -> Iterator[ScanTable]:
        """Yield tables of whole frames, which need less memory than one table of the scan."""
        scanner, rows = self._scanner(rng), 0
        at_a_time = rays_in_a_portion // scanner.rays_per_frame
        for frames in _portions(range(self.sweep.frames), at_a_time):
            table = scanner.table(frames, _RAYS_AT_A_TIME, progress)
            rows += len(table)
            if len(table):
                yield table
        if rows == 0:
            raise scanner.no_return()

    def check(self) -> None:
        """Raise InputError if the mesh, or the sensor's position or path, is invalid."""
        self._caster()

    def _scanner(self, rng: np.random.Generator) -> _Scanner:
        return _Scanner(self._caster(), self.sensor, self.sweep, self.model, Draws(rng))

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
    """Scan a mesh with a virtual sensor (thesis, section 5.2); return a table of returns.

    Each row is a nominal ray with a return, in the order of firing (frame, azimuth step, laser).
    Clean values describe the true intersection of the nominal ray with the surface, noisy values
    the measurement. If the error model fires a deviating ray (beam divergence), the sensor measures
    along that ray, and both rays must hit a surface within range.

    Parameters
    ----------
    mesh
        The scene, m, z up.
    origin
        (3,), position of the sensor or origin of its trajectory, m.
    rng
        Generator that seeds the random streams of errors.

    Raises
    ------
    InputError
        The mesh has no faces, the origin is invalid or touches the mesh, or no ray returned.
    """
    return ScanJob(mesh, sensor, sweep, model, origin).table(rng, progress)


@dataclass(frozen=True)
class _Scanner:
    caster: RayCaster
    sensor: Sensor
    sweep: Sweep
    model: ErrorModel
    draws: Draws

    @property
    def rays_per_frame(self) -> int:
        return self.sweep.steps(self.sensor) * self.sensor.lasers

    @cached_property
    def about(self) -> dict[str, Any]:
        return _about(self.sensor, self.sweep, self.model, self.caster.origin)

    def no_return(self) -> InputError:
        place = self.caster.origin.tolist()
        return InputError(f"no ray returned to a sensor at {place}: is it inside the scene?")

    def table(self, frames: range, rays_at_a_time: int, progress: Progress | None) -> ScanTable:
        columns = empty_columns(ScanTable.schema, len(frames) * self.rays_per_frame)
        rows = 0
        for portion in _portions(frames, rays_at_a_time // self.rays_per_frame):
            rows = self.add_returns(portion, columns, rows)
            if progress is not None:
                progress(portion.stop, self.sweep.frames)
        return ScanTable({name: column[:rows] for name, column in columns.items()}, self.about)

    def add_returns(self, frames: range, columns: dict[str, NDArray[Any]], row: int) -> int:
        """Scan frames; write their returns from `row` on; return the next free row."""
        nominal = self.sweep.rays(self.sensor, frames)
        fired = self.model.perturb_rays(nominal, self.sensor, self.draws)
        truth = self._cast(nominal, frames)
        measured = truth if fired is nominal else self._cast(fired, frames)
        if self.mirrors is not None:
            measured = follow_mirrors(self.caster, measured, self.mirrors, self._limits[1])
        hits = self.model.merge_hits(measured.hits, self.sensor)
        distance = self.model.perturb_ranges(hits, self.sensor, self.draws)
        lift = self.model.lift_points(hits, self.sensor, self.draws)
        returned = np.isfinite(distance) & np.isfinite(truth.hits.distance)
        placed = measured if fired.placed_as_fired else truth
        noisy = (distance, placed.directions)
        end = self._write(frames, nominal, truth, noisy, returned, columns, row)
        if lift is not None:
            step_of_row = np.flatnonzero(returned) // returned.shape[2]
            origins = truth.origins[step_of_row]
            _lift(lift[returned], origins, {k: v[row:end] for k, v in columns.items()})
        return end

    def _cast(self, rays: Rays, frames: range) -> Cast:
        return self.caster.cast(rays, self.sweep.poses(self.sensor, frames), self._limits)

    @cached_property
    def mirrors(self) -> NDArray[np.bool_] | None:
        return mirrors_of(self.model, self.caster.surfaces)

    @property
    def _limits(self) -> tuple[float, float]:
        return self.sensor.min_range_m, self.sweep.max_range_m or self.sensor.max_range_m

    def _write(
        self,
        frames: range,
        nominal: Rays,
        truth: Cast,
        noisy: tuple[Floats, Floats],
        returned: NDArray[np.bool_],
        columns: dict[str, NDArray[Any]],
        row: int,
    ) -> int:
        from puckbench.lidar import kernels

        hits, flat, origin = truth.hits, returned.ravel(), truth.origins
        times = self.sweep.firing_times(self.sensor, frames)
        angles = (times, nominal.yaw, nominal.pitch)
        fired = tuple(columns[name] for name in ("frame", "laser_id", "timestamp", "yaw", "pitch"))
        end: int = kernels.fill_rays(returned, angles, frames.start, row, fired)
        clean_out = tuple(columns[name] for name in ("distance", "x", "y", "z"))
        kernels.fill_points(flat, origin, truth.directions, hits.distance.ravel(), row, clean_out)
        noisy_out = tuple(columns[f"{name}_noisy"] for name in ("distance", "x", "y", "z"))
        kernels.fill_points(flat, origin, noisy[1], noisy[0].ravel(), row, noisy_out)
        struck = (truth.directions, hits.triangle.ravel(), hits.incidence.ravel())
        surface = (self.caster.planes, self.caster.object_id, self.caster.primitive_id)
        names = ("incidence", "triangle_id", "object_id", "primitive_id", "nx", "ny", "nz")
        kernels.fill_surface(flat, struck, surface, row, tuple(columns[name] for name in names))
        return end


def _lift(along: Floats, origins: Floats, columns: dict[str, NDArray[Any]]) -> None:
    squared = np.zeros(len(along))
    for place, axis in zip(origins.T, "xyz", strict=True):
        points = columns[f"{axis}_noisy"]
        points += along * columns[f"n{axis}"]
        squared += (points - place) ** 2
    columns["distance_noisy"][:] = np.sqrt(squared)


def _checked_origin(origin: Floats | Sequence[float]) -> Floats:
    try:
        place = np.asarray(origin, dtype=np.float64)
    except (TypeError, ValueError):
        place = np.empty(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError(f"the sensor's origin is {origin}, but must be three finite numbers")
    return place


def _portions(frames: range, at_a_time: int) -> list[range]:
    step = max(at_a_time, 1)
    return [frames[first : first + step] for first in range(0, len(frames), step)]


def _about(sensor: Sensor, sweep: Sweep, model: ErrorModel, origin: Floats) -> dict[str, Any]:
    about = {
        "sensor": sensor.model_dump(),
        "sweep": sweep.model_dump(),
        "errors": model.described(),
        "origin": origin.tolist(),
    }
    # With lists instead of tuples, as read from a file.
    as_read: dict[str, Any] = json.loads(json.dumps(about))
    return as_read
