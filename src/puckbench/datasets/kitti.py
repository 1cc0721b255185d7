"""KITTI (Geiger 2012): frames of a real HDL-64E on a car, as binary float32 clouds."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import PositiveInt

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.datasets.base import FolderSet, Provenance, chosen
from puckbench.datasets.counts import Count
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene, safe_name
from puckbench.geometry.cloud import PointCloud, check_points

_LAYOUTS = (  # object benchmark, odometry, the same as unpacked, raw drives
    "*/velodyne",
    "sequences/*/velodyne",
    "dataset/sequences/*/velodyne",
    "*/*/velodyne_points/data",
)
_PUBLISHED = {
    "training": 7481, "testing": 7518, "00": 4541, "01": 1101, "02": 4661, "03": 801, "04": 271,
    "05": 2761, "06": 1101, "07": 1101, "08": 4071, "09": 1591, "10": 1201,
}  # fmt: skip
_EXPECTED = (
    "KITTI should lie there, with training/velodyne, sequences/00/velodyne or "
    "<date>/<drive>/velodyne_points/data in it; registration at cvlibs.net/datasets/kitti"
)
_POINT_BYTES = 16


@LOADERS.register("kitti")
class Kitti(FolderSet):
    """Frames ``<n>.bin`` of float32 x, y, z, intensity, in metres, z up, the sensor at the origin.

    The folder is that of the object benchmark, the odometry or the raw drives. Scenes are called
    training_000000 and grouped by part. Intensity is left out.
    """

    of_clouds: ClassVar[bool] = True
    provenance = Provenance(
        "CC BY-NC-SA 3.0",
        'A. Geiger, P. Lenz, R. Urtasun, "Are we ready for Autonomous Driving?", CVPR 2012',
        _EXPECTED,
    )

    parts: tuple[str, ...] | None = None
    """Names of parts to keep (training, 00, 2011_09_26_drive_0001_sync); all by default."""
    every: PositiveInt = 1
    """Step between the frames that are used, as neighbouring frames are nearly alike."""

    def load(self, name: str) -> Scene:
        """Read the frame; `about` has the number of points that were not finite and dropped."""
        path = self._file(name)
        data = read_bytes(path)
        if len(data) % _POINT_BYTES:
            raise InputError(f"{path}: truncated: {len(data)} bytes are not whole points of 16")
        xyz = np.frombuffer(data, dtype="<f4").reshape(-1, 4)[:, :3].astype(np.float64)
        finite = np.isfinite(xyz).all(axis=1)
        check_points(xyz[finite], str(path))
        part = _part_of(name)
        dropped = int(np.count_nonzero(~finite))
        about = self._about(f"KITTI {part}/{path.name}", dropped_points=dropped)
        cloud = PointCloud(xyz[finite], about=about)
        return Scene(name, part, cloud=cloud, origin=(0.0, 0.0, 0.0), about=about)

    def counts(self) -> list[Count]:
        """Frames of each part whose number is published."""
        held = [_part_of(name) for name in self._whole().names()]
        parts = [part for part in sorted(set(held)) if part in _PUBLISHED]
        return [Count(part, held.count(part), _PUBLISHED[part]) for part in parts]

    def _listed(self, folder: Path) -> Mapping[str, Path]:
        places = (path for layout in _LAYOUTS for path in sorted(folder.glob(layout)))
        folders = {_part(path): path for path in places}
        table = {
            f"{part}_{frame[:-4]}": folders[part] / frame
            for part in sorted(chosen("parts", self.parts, list(folders)) if folders else [])
            for frame in _frames(folders[part])[:: self.every]
        }
        if not table:
            raise self._missing("frames (.bin)")
        return table


def _part(folder: Path) -> str:
    """The split, sequence or drive that a folder of frames belongs to."""
    return safe_name((folder if folder.name == "velodyne" else folder.parent).parent.name)


def _part_of(name: str) -> str:
    return name.rpartition("_")[0]


def _frames(folder: Path) -> list[str]:
    names = sorted(entry.name for entry in os.scandir(folder))
    return [name for name in names if name.endswith(".bin") and not name.startswith(".")]
