from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, PositiveFloat

from cloud_files.descriptions import read_description, sidecar
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.models import Model, parsed
from pointkit.seeding import generator
from pointkit.terminal import Progress
from puckbench.core.code import MESH_FILES, SENSOR
from puckbench.geometry.extent import warn_of_implausible_extent
from puckbench.jobs.registry import JOBS, Job
from puckbench.jobs.surfaces import read_surface
from virtual_lidar import (
    ErrorModel,
    ScanJob,
    Sweep,
    free_origin,
    open_error_model,
    open_sweep,
    write_scan,
    write_scan_portions,
)

CODE = (*MESH_FILES, *SENSOR, "puckbench.geometry.extent", "puckbench.jobs.surfaces")

_RAYS_IN_MEMORY = 4_000_000
"""Number of rays (about 600 MB of memory) above which a scan is made and written in portions."""


class Scanning(Job):
    """Base class of jobs that scan a mesh with the virtual sensor.

    Parameters
    ----------
    sensor
        Name of a sensor, or YAML file that defines one.
    errors, error_options
        Name or place (``file.py:Name``) of the error model, and changes to its parameters.
    sweep
        Name of a sweep, i.e. of a motion of the sensor during the scan.
    origin
        Position x, y, z of the sensor, in m. By default, it is the position in the scene's
        description. If this has none, it is the unoccupied position nearest to the middle,
        `height_m` above the floor.
    height_m
        Height of the sensor above the floor, in m, if neither `origin` nor the scene gives a
        position.
    anywhere
        Whether the sensor may stand outside the scene or inside an object, or pass through walls.
    seed
        Seed of the sensor's errors.
    metres_per_unit
        Factor by which the coordinates of the mesh are multiplied.
    """

    sensor: str = "vlp16"
    errors: str = "none"
    error_options: dict[str, Any] = Field({})
    sweep: str | dict[str, Any] = "thesis"
    origin: tuple[float, float, float] | None = None
    height_m: float = Field(1.3, gt=0)
    anywhere: bool = False
    seed: int = Field(0, ge=0)
    metres_per_unit: PositiveFloat = 1.0

    def plugins(self) -> Iterable[str | None]:
        return (self.errors,)

    def scan_of(self, mesh: Path) -> tuple[ScanJob, np.random.Generator]:
        """Return the prepared scan of a mesh file, and the random generator of its errors."""
        named = self._named()  # reports unknown names before a large mesh is read
        surface = read_surface(mesh, self.metres_per_unit)
        warn_of_implausible_extent(mesh, surface.bounds())
        job = self._job(named, surface, described_origin(mesh))
        return job, generator(self.seed, "scan", mesh.stem)

    def check(self, surface: Mesh, described: Sequence[float] | None) -> None:
        """Raise InputError if the sensor has no valid position in a mesh.

        `described` is the position x, y, z, in m, in the scene's description, if there is one.
        """
        self._job(self._named(), surface, described).check()

    def _job(
        self,
        named: tuple[Sensor, Sweep, ErrorModel],
        surface: Mesh,
        described: Sequence[float] | None,
    ) -> ScanJob:
        origin, vouched = self._origin(surface, described)
        return ScanJob(surface, *named, origin, self.anywhere or vouched)

    def _named(self) -> tuple[Sensor, Sweep, ErrorModel]:
        model = open_error_model(self.errors, self.error_options)
        return load_sensor(self.sensor), open_sweep(self.sweep), model

    def _origin(
        self, surface: Mesh, described: Sequence[float] | None
    ) -> tuple[Floats | Sequence[float], bool]:
        if self.origin is not None:
            return self.origin, False
        if described is not None:
            return described, True
        inside = {"inside": 0.0} if self.anywhere else {}
        return free_origin(surface, self.height_m, **inside), False


@JOBS.register("scan")
class Scan(Scanning):
    """Scan a mesh with the virtual sensor."""

    def run(self, mesh: Path, table: Path) -> dict[str, Any]:
        """Scan the file `mesh`, write a table of the returns to `table`, and return facts."""
        job, rng = self.scan_of(mesh)
        progress = Progress("frame")
        if job.rays > _RAYS_IN_MEMORY:
            rows = write_scan_portions(table, job.portions(rng, progress))
        else:
            returns = job.table(rng, progress)
            write_scan(table, returns)
            rows = len(returns)
        origin = [float(x) for x in job.origin]
        return {"returns": rows, "origin": origin, "errors": self.errors}


class _Described(Model):
    origin: tuple[float, float, float] | None


def described_origin(mesh: Path) -> list[float] | None:
    """Return the position x, y, z of the sensor, in m, from the description beside a mesh.

    If there is no description, or it has no position, return None.
    """
    origin = (read_description(mesh) or {}).get("origin")
    position = parsed(_Described, {"origin": origin}, str(sidecar(mesh))).origin
    return None if position is None else list(position)
