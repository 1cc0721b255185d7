from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from cloud_files.clouds import read_cloud, write_cloud
from pointkit.errors import InputError
from pointkit.files import read_object
from pointkit.geometry.cloud import Floats, PointCloud, bounds
from pointkit.models import Model, parsed
from puckbench.core.code import CLOUD_FILES
from puckbench.geometry.extent import warn_of_implausible_extent
from puckbench.geometry.scaling import METRIC
from puckbench.steps.step import STEPS, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow
    from puckbench.steps.preparation import MeasuredPoints

CODE = (
    *CLOUD_FILES,
    "puckbench.geometry.extent",
    "puckbench.steps.preparation",
    "virtual_lidar.scan_table",
)

Corner = tuple[float, float, float]


class _Boxed(Model):
    box: tuple[Corner, Corner]


class NormalSettings(Model):
    """Settings of the estimate of normals."""

    neighbours: int = Field(
        30, ge=3, description="Number of neighbouring points for the estimate of a normal."
    )


class PreparationSettings(NormalSettings):
    """Settings of the preparation of a cloud for coding: cropping, scale and normals."""

    crop: Literal["clean", "noisy", "none"] = Field(
        "clean",
        description="Crop a scan to the room's bounding box by its `clean` coordinates, by its "
        "`noisy` ones (as the thesis did), or not at all. Clouds with `size: metric` are not "
        "cropped.",
    )
    size: Annotated[int, Field(ge=2)] | Literal["grid", "metric"] = Field(
        1024,
        description="Clouds are scaled to the cube [0, size - 1]. `grid`: voxels keep their grid "
        "(`make: cloud`). `metric`: clouds stay in metres, in the frame of their sensor if there "
        "is one, and rates are lengths (`10mm`).",
    )

    @property
    def is_metric(self) -> bool:
        """Whether the clouds stay in metres; otherwise, they are scaled to a cube."""
        return self.size == METRIC


@STEPS.register("prepare")
class Prepare(PreparationSettings, Step):
    """Prepare a cloud for coding: crop it, scale it, and estimate its normals.

    This is the preparation of section 6.1 of the thesis.
    """

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str) -> PlannedStep:
        settings, files = flow.plan.datasets[dataset].settings, flow.files
        crop = settings.crop if settings.is_scan and not settings.is_metric else "none"
        return planned(
            cls(crop=crop, size=settings.size, neighbours=settings.neighbours),
            files.sources(dataset, cloud),
            also=f"{settings.make} {settings.scene_set}",
            memory_mb=files.memory_mb(dataset),
        )

    def run(self, source: Path, about: Path, cloud: Path, truth: Path) -> dict[str, Any]:
        """Write the prepared cloud, and return its description.

        Parameters
        ----------
        source
            Cloud to prepare, or table of a scan (``.parquet``).
        about
            Description of the scene (JSON), from which its name and group are copied. Its ``box``
            crops the cloud, unless `crop` is ``none``.
        cloud
            File to write.
        truth
            File to which the clean points are written, in the coordinate frame of `cloud`.
        """
        box = None if self.crop == "none" else box_of(about)
        names = names_and_groups(cloud, about)
        return self.write(source, measured_points(source), names, cloud, truth, box)

    def write(
        self,
        source: Path,
        points: MeasuredPoints,
        names: dict[str, Any],
        cloud: Path,
        truth: Path | None = None,
        box: Floats | None = None,
        more: dict[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Write measured points as `run` does, and return the description of the cloud.

        Parameters
        ----------
        source
            File of the points, for messages.
        points
            The measured points, with their true points.
        names
            Result of `names_and_groups`.
        cloud, truth
            Files to write; the latter is optional.
        box
            Lowest and highest corner (2, 3), in m, to which the points are cropped; None for all.
        more
            Further entries of the description.
        """
        from puckbench.steps.preparation import prepare

        if self.is_metric and source.suffix != ".parquet":
            warn_of_implausible_extent(source, bounds(points.cloud.xyz))
        if box is not None:
            points = points.cropped(box, self.crop)
        if len(points.cloud) == 0:
            raise InputError(f"{source}: no point is left after cropping")
        prepared = prepare(points.cloud, self.size, self.neighbours)
        described = {**names, **prepared.about, **(more or {})}
        write_cloud(cloud, replace(prepared, about=described))
        if truth:
            write_cloud(truth, points.truth_in_frame_of(prepared))
        return {**described, "points": len(prepared)}


def measured_points(path: Path) -> MeasuredPoints:
    """Return the points of a scan (``.parquet``) or of a cloud, in m, with their true points."""
    from puckbench.steps.preparation import MeasuredPoints

    if path.suffix == ".parquet":
        return points_of_scan(path)
    cloud = in_metres(read_cloud(path))
    return MeasuredPoints(cloud, clean=cloud)


def in_metres(cloud: PointCloud) -> PointCloud:
    """Undo the scaling and shift of a prepared cloud, unless it is in a sensor's frame."""
    if cloud.frame is None or "sensor" in cloud.about:
        return cloud
    return replace(cloud, xyz=cloud.to_metres(cloud.xyz))


def box_of(path: Path) -> Floats:
    """Return the lowest and highest corner (2, 3), m, of the ``box`` in a scene's description."""
    box = read_object(path).get("box")
    if box is None:
        raise InputError(f"{path}: has no 'box' to crop to")
    return np.asarray(parsed(_Boxed, {"box": box}, str(path)).box, dtype=np.float64)


def points_of_scan(path: Path, clean: bool = False) -> MeasuredPoints:
    """Return the points of a table of a scan, with their true points.

    With `clean`, the points without the sensor's errors are returned as measured points.
    """
    from puckbench.steps.preparation import MeasuredPoints
    from virtual_lidar.scan_table import read_scan

    table = read_scan(path)
    about = {"source": path.name, **table.about}
    true = PointCloud(table.xyz, table.normals, labels=table.primitive_id, about=about)
    measured = true if clean else replace(true, xyz=table.xyz_noisy)
    return MeasuredPoints(measured, clean=true)


def names_and_groups(cloud: Path, *descriptions: Path) -> dict[str, Any]:
    """Return a cloud's ``name`` and ``group`` from descriptions (JSON files) of its scene.

    If the name of the scene is not that of the file `cloud`, ``name`` is the name of the file, and
    ``scene`` is the name of the scene. This is so for scenes of which several clouds are made.
    """
    names: dict[str, Any] = {}
    for path in descriptions:
        about = read_object(path)
        names.update({key: about[key] for key in ("name", "group") if key in about})
    scene = names.get("name")
    if isinstance(scene, str) and scene != cloud.stem:
        names |= {"name": cloud.stem, "scene": scene}
    return names
