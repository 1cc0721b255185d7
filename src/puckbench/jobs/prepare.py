from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat

from cloud_files.clouds import checked_cloud, read_unchecked_cloud, write_cloud
from pointkit.errors import InputError
from pointkit.files import read_object
from pointkit.geometry.cloud import Floats, PointCloud, UncheckedCloud, bounds
from pointkit.models import Model, parsed
from puckbench.core.code import CLOUD_FILES
from puckbench.geometry.extent import warn_of_implausible_extent
from puckbench.jobs.registry import JOBS, Job

if TYPE_CHECKING:
    from puckbench.jobs.preparation import MeasuredPoints

CODE = (
    *CLOUD_FILES,
    "puckbench.geometry.extent",
    "puckbench.jobs.preparation",
    "virtual_lidar.scan_table",
)

Box = tuple[float, float, float, float, float, float]
Corner = tuple[float, float, float]


class _Boxed(Model):
    box: tuple[Corner, Corner]


@JOBS.register("prepare")
class Prepare(Job):
    """Prepare a cloud for coding: crop it, scale it, and estimate its normals.

    This is the preparation of section 6.1 of the thesis.

    Parameters
    ----------
    crop
        Whether a scan is cropped by its ``clean`` coordinates (without the sensor's errors), by its
        ``noisy`` ones, or not at all (``none``).
    box
        Two opposite corners, x, y, z and x, y, z in m, of the box to which the cloud is cropped; by
        default the scene's box, if there is one.
    size
        Number of grid positions along a side of the cube to which the cloud is scaled; 0 keeps
        metres, ``grid`` keeps the integer grid of a voxelised cloud.
    neighbours
        Number of neighbouring points from which a normal is estimated.
    clean
        Whether to take the clean points of a scan, instead of those with the sensor's errors.
    peak
        PSNR peak, in m, of a cloud in metres.
    drop_invalid
        Whether to drop points that are not finite; otherwise, such points raise InputError.
    keep_missing
        Whether to keep missing returns, i.e. points that stand for pulses without an echo.
    bin_columns
        Names of the columns of a ``.bin`` file.
    metres_per_unit
        Factor by which the coordinates of the cloud are multiplied.
    """

    crop: Literal["clean", "noisy", "none"] = "clean"
    box: Box | None = None
    size: int | Literal["grid"] = 1024
    neighbours: int = Field(30, ge=3)
    clean: bool = False
    peak: float | None = Field(None, gt=0)
    drop_invalid: bool = False
    keep_missing: bool = False
    bin_columns: str | None = None
    metres_per_unit: PositiveFloat = 1.0

    def run(
        self,
        source: Path,
        cloud: Path,
        truth: Path | None = None,
        box: Path | None = None,
        about: tuple[Path, ...] = (),
    ) -> dict[str, Any]:
        """Write the prepared cloud, and return its description.

        Parameters
        ----------
        source
            Cloud to prepare, or table of a scan (``.parquet``).
        cloud
            File to write.
        truth
            If set, file to which the clean points are written, in the coordinate frame of `cloud`.
        box
            Description of the scene (JSON), whose ``box`` crops the cloud unless the setting `box`
            is set.
        about
            Descriptions of the scene (JSON), from which its name and group are copied.
        """
        from puckbench.jobs.preparation import prepare

        peak, points = self._peak(), self._points(source)
        if self.size == 0 and source.suffix != ".parquet":
            warn_of_implausible_extent(source, bounds(points.cloud.xyz))
        corners = self._corners(box)
        if corners is not None and self.crop != "none":
            points = points.cropped(corners, self.crop)
        if len(points.cloud) == 0:
            raise InputError(f"{source}: no point is left after cropping")
        prepared = prepare(points.cloud, self.size, self.neighbours)
        described = {**names_and_groups(cloud, about), **prepared.about, **peak}
        write_cloud(cloud, replace(prepared, about=described))
        if truth:
            write_cloud(truth, points.truth_in_frame_of(prepared))
        return {**described, "points": len(prepared)}

    def _peak(self) -> dict[str, float]:
        if self.peak is None:
            return {}
        if self.size != 0:
            raise InputError(
                "peak: only for clouds in metres; that of a scaled cloud is its size - 1"
            )
        return {"peak": self.peak}

    def _points(self, path: Path) -> MeasuredPoints:
        if path.suffix == ".parquet":
            return _of_scan(path, self.clean)
        from puckbench.jobs.preparation import MeasuredPoints

        cloud = checked_cloud(self._cloud(path), path)
        # Undo the shift of a prepared cloud, unless it is in a sensor's frame.
        if cloud.frame is not None and "sensor" not in cloud.about:
            cloud = replace(cloud, xyz=cloud.to_metres(cloud.xyz))
        if self.metres_per_unit != 1:
            unit = {"metres_per_unit": cloud.metres_per_unit * self.metres_per_unit}
            xyz = cloud.xyz * self.metres_per_unit
            cloud = replace(cloud, xyz=xyz, about={**cloud.about, **unit})
        return MeasuredPoints(cloud, clean=cloud)

    def _cloud(self, path: Path) -> UncheckedCloud:
        convert = self.metres_per_unit == 1
        options = (self.keep_missing, self.drop_invalid, self.bin_columns, convert)
        return read_unchecked_cloud(path, *options)

    def _corners(self, path: Path | None) -> Floats | None:
        if self.box is not None:
            return np.sort(np.asarray(self.box, dtype=np.float64).reshape(2, 3), axis=0)
        if path is None:
            return None
        box = read_object(path).get("box")
        if box is None:
            raise InputError(f"{path}: has no 'box' to crop to")
        return np.asarray(parsed(_Boxed, {"box": box}, str(path)).box, dtype=np.float64)


def _of_scan(path: Path, clean: bool) -> MeasuredPoints:
    from puckbench.jobs.preparation import MeasuredPoints
    from virtual_lidar.scan_table import read_scan

    table = read_scan(path)
    about = {"source": path.name, **table.about}
    true = PointCloud(table.xyz, table.normals, labels=table.primitive_id, about=about)
    measured = true if clean else replace(true, xyz=table.xyz_noisy)
    return MeasuredPoints(measured, clean=true)


def names_and_groups(cloud: Path, descriptions: tuple[Path, ...]) -> dict[str, Any]:
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
