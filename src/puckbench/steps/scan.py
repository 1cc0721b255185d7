from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import Field

from cloud_files.descriptions import read_description, sidecar
from cloud_files.meshes import read_mesh
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.models import Model, parsed
from pointkit.seeding import generator
from pointkit.terminal import Progress
from puckbench.core.code import MESH_FILES, SENSOR
from puckbench.geometry.extent import warn_of_implausible_extent
from puckbench.steps.step import STEPS, PlannedStep, Step, planned
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

if TYPE_CHECKING:
    from puckbench.planning.config import Sensing
    from puckbench.planning.workflow import Workflow

CODE = (*MESH_FILES, *SENSOR, "puckbench.geometry.extent")

_RAYS_IN_MEMORY = 4_000_000
"""Number of rays (about 600 MB of memory) above which a scan is made and written in portions."""


class SensorSettings(Model):
    """The virtual sensor, its motion and its errors."""

    sensor: str = Field(
        "vlp16", description="Name of a sensor, or a YAML file that defines one (`make: scan`)."
    )
    sweep: dict[str, Any] | str = Field(
        {},
        description="Name of a sweep (`thesis`, `thesis_room`, `spin`), or changes to the thesis's "
        "sweep (`make: scan`).",
    )
    errors: str = Field("none", description="Error model (`make: scan`).")
    error_options: dict[str, Any] = Field(
        {}, description="Changes to the error model's parameters."
    )
    height_m: float = Field(
        1.3,
        gt=0,
        description="Height of the sensor above the floor in m, if the scene has no position for "
        "it.",
    )
    anywhere: bool = Field(
        False,
        description="Scan even if the sensor is outside the scene or inside an object, or passes "
        "through walls.",
    )


class Scanning(SensorSettings, Step):
    """Base class of steps that scan a mesh with the virtual sensor.

    Parameters
    ----------
    origin
        Position x, y, z of the sensor, in m. By default, it is the position in the scene's
        description. If this has none, it is the unoccupied position nearest to the middle,
        `height_m` above the floor.
    seed
        Seed of the sensor's errors.
    """

    origin: tuple[float, float, float] | None = None
    seed: int = Field(0, ge=0)

    @classmethod
    def of_entry(cls, entry: Sensing, scene: str, seed: int) -> Self:
        """Return the step that scans a scene with the settings of a configuration's entry.

        Parameters
        ----------
        entry
            Entry of a data set or a drive.
        scene
            Name of the scene.
        seed
            Seed of the sensor's errors.
        """
        origin = entry.origin.get(scene) if isinstance(entry.origin, dict) else entry.origin
        shared = {name: getattr(entry, name) for name in SensorSettings.model_fields}
        return cls(**shared, origin=origin, seed=seed)

    def plugins(self) -> Iterable[str | None]:
        return (self.errors,)

    def scan_of(
        self, mesh: Path, read: Callable[[Path], Mesh] = read_mesh
    ) -> tuple[ScanJob, np.random.Generator]:
        """Return the prepared scan of a mesh file, and the random generator of its errors.

        `read` is the function that reads the file as a mesh in metres.
        """
        named = self._named()  # reports unknown names before a large mesh is read
        surface = read(mesh)
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


@STEPS.register("scan")
class Scan(Scanning):
    """Scan a mesh with the virtual sensor."""

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str) -> PlannedStep:
        data, files = flow.plan.datasets[dataset], flow.files
        code, also = flow.plan.code_of_scan(data.settings)
        return planned(
            cls.of_entry(data.settings, *data.source_of(cloud)),
            files.scene_and_about(dataset, cloud),
            *code.modules,
            content={"files": code.files},
            also=also,
            memory_mb=files.memory_mb(dataset),
        )

    def run(self, mesh: Path, table: Path) -> dict[str, Any]:
        """Scan the file `mesh`, write a table of the returns to `table`, and return facts."""
        return self.write(*self.scan_of(mesh), table)

    def write(self, job: ScanJob, rng: np.random.Generator, table: Path) -> dict[str, Any]:
        """Make a scan that `scan_of` has prepared, write it as `run` does, and return facts."""
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
