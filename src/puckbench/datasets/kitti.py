"""KITTI (Geiger 2012): frames of a real HDL-64E on a car, as binary float32 clouds."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.datasets.counts import Count
from puckbench.datasets.embedded import chosen
from puckbench.datasets.scene import Scene, existing_folder, found, safe_name
from puckbench.geometry.cloud import PointCloud, check_points

_LAYOUTS = (  # object benchmark, odometry, the same as unpacked, raw drives
    "*/velodyne",
    "sequences/*/velodyne",
    "dataset/sequences/*/velodyne",
    "*/*/velodyne_points/data",
)
_PUBLISHED = {
    "training": 7481,
    "testing": 7518,
    "00": 4541,
    "01": 1101,
    "02": 4661,
    "03": 801,
    "04": 271,
    "05": 2761,
    "06": 1101,
    "07": 1101,
    "08": 4071,
    "09": 1591,
    "10": 1201,
}
_LICENCE = "CC BY-NC-SA 3.0"
_CREDIT = 'A. Geiger, P. Lenz, R. Urtasun, "Are we ready for Autonomous Driving?", CVPR 2012'
_ASK = (
    "KITTI should lie there, with training/velodyne, sequences/00/velodyne or "
    "<date>/<drive>/velodyne_points/data in it; registration at cvlibs.net/datasets/kitti"
)


@dataclass(frozen=True)
class Kitti:
    """Frames ``<n>.bin`` of float32 x, y, z, intensity, in metres, z up, the sensor at the origin.

    path: the folder of the object benchmark, the odometry or the raw drives. parts: names of
    parts to keep (training, 00, 2011_09_26_drive_0001_sync); all by default. every: take one
    frame of so many, as neighbours are nearly alike. Scenes are called training_000000 and
    grouped by part. Intensity is left out.
    """

    path: str
    parts: tuple[str, ...] | None = None
    every: int = 1

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InputError(f"every: {self.every} is not at least 1")

    def names(self) -> list[str]:
        """Part and number of every frame; lists folders, reads no frame."""
        return list(self._table)

    def files(self, name: str) -> list[Path]:
        """The frame's file."""
        return [found(self._table, name, self.path)]

    def load(self, name: str) -> Scene:
        """Read the frame; `about` tells how many points were not finite and dropped."""
        path = found(self._table, name, self.path)
        data = read_bytes(path)
        if len(data) % 16:
            raise InputError(f"{path}: truncated: {len(data)} bytes are not whole points of 16")
        xyz = np.frombuffer(data, dtype="<f4").reshape(-1, 4)[:, :3].astype(np.float64)
        finite = np.isfinite(xyz).all(axis=1)
        check_points(xyz[finite], str(path))
        part = name.rpartition("_")[0]
        about = {
            "source": f"KITTI {part}/{path.name}",
            "licence": _LICENCE,
            "credit": _CREDIT,
            "dropped_points": int(np.count_nonzero(~finite)),
        }
        cloud = PointCloud(xyz[finite], about=about)
        return Scene(name, part, cloud=cloud, origin=(0.0, 0.0, 0.0), about=about)

    def counts(self) -> list[Count]:
        """Frames of each part whose number is published."""
        held = [name.rpartition("_")[0] for name in replace(self, parts=None, every=1).names()]
        parts = [part for part in sorted(set(held)) if part in _PUBLISHED]
        return [Count(part, held.count(part), _PUBLISHED[part]) for part in parts]

    @cached_property
    def _table(self) -> dict[str, Path]:
        root = existing_folder(self.path, _ASK)
        found_here = (path for layout in _LAYOUTS for path in sorted(root.glob(layout)))
        folders = {_part(path): path for path in found_here}
        table = {
            f"{part}_{frame[:-4]}": folders[part] / frame
            for part in sorted(chosen("parts", self.parts, list(folders)) if folders else [])
            for frame in _frames(folders[part])[:: self.every]
        }
        if not table:
            raise InputError(f"{self.path}: no frames (.bin) there ({_ASK})")
        return table


def _part(folder: Path) -> str:
    """The split, sequence or drive that a folder of frames belongs to."""
    return safe_name((folder if folder.name == "velodyne" else folder.parent).parent.name)


def _frames(folder: Path) -> list[str]:
    names = sorted(entry.name for entry in os.scandir(folder))
    return [name for name in names if name.endswith(".bin") and not name.startswith(".")]
