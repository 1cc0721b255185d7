"""KITTI (Geiger 2012): frames of an HDL-64E on a car, as binary float32 clouds.

References
----------
A. Geiger et al., "Vision meets Robotics: The KITTI Dataset", IJRR 2013, section III;
readme.txt of the development kit: float32 x (forward), y (left), z (up) and reflectance.
In the files, rings follow each other from the highest laser down, each from azimuth 0. Azimuths
are multiples of 0.09 degrees plus an offset of the laser.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from cloud_files.clouds import without_invalid, without_missing
from cloud_files.float32_frames import check_column_count, float32_rows
from cloud_files.missing_returns import missing_returns
from cloud_files.poses import read_kitti_calibration, read_poses, read_times
from pointkit.errors import InputError, naming
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats, UncheckedCloud, check_points
from puckbench.scene_sets.base import Count, select_names
from puckbench.scene_sets.frames import FrameSet
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name

if TYPE_CHECKING:
    from puck.recordings.rings import RecoveredReturns

CODE = (
    "cloud_files.float32_frames",
    "cloud_files.poses",
    "puckbench.scene_sets.frames",
    "puck.recordings.rings",
)

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
_COLUMNS = 4
_RINGS = 64
TURNED = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
"""Rotation from axes x right, y forward to x forward, y left."""
_STEP_DEG = 0.09
"""Resolution of the rotary encoder; firings are two encoder steps apart, sometimes one."""


def frame_rows(path: Path) -> NDArray[np.float32]:
    """Return the rows (n, 4) of a frame's file: x, y, z in m and reflectance, 0 to 1."""
    data = read_bytes(path)
    check_column_count(path, data, _COLUMNS)
    return float32_rows(data, _COLUMNS, path)


def cloud_of_rows(rows: NDArray[np.float32]) -> UncheckedCloud:
    """Return the points of `frame_rows` as a cloud of which no point was dropped."""
    return UncheckedCloud(rows[:, :3].astype(np.float64), about={"dropped_points": 0})


@LOADERS.register("kitti")
class Kitti(FrameSet):
    """The scenes are frames ``<n>.bin`` of KITTI, in metres, with the sensor at (0, 0, 0).

    The folder is that of the object benchmark, odometry benchmark or raw drives. Scenes are named
    training_000000 (part and frame) and grouped by part. Intensity is ignored. The option `returns`
    converts each frame to the sensor's returns (x right, y forward): laser, encoder step, and range
    in steps of 2 mm. They reproduce the points to about 1 mm, but those of odometry frames, which
    are corrected for the car's motion, only to centimetres. An odometry frame has a pose if
    ``poses/00.txt`` is beside ``sequences``, or ``poses.txt`` (SemanticKITTI) in the sequence's
    folder, and a time if ``times.txt`` is there.
    """

    licence = "CC BY-NC-SA 3.0"
    credit = 'A. Geiger, P. Lenz, R. Urtasun, "Are we ready for Autonomous Driving?", CVPR 2012'
    expected = (
        "expected KITTI, with training/velodyne, sequences/00/velodyne or "
        "<date>/<drive>/velodyne_points/data; registration at cvlibs.net/datasets/kitti"
    )

    collection: ClassVar[str] = "KITTI"
    """Name of the collection of frames, for descriptions of scenes."""

    parts: tuple[str, ...] | None = None
    """Names of parts to keep (training, 00, 2011_09_26_drive_0001_sync); all by default."""

    def files(self, name: str) -> list[Path]:
        frame = self.file_of(name)
        return [frame, *filter(Path.is_file, _motion_files(frame.parent.parent))]

    def load(self, name: str) -> Scene:
        path = self.file_of(name)
        cloud = without_invalid(self.read(path), path)
        if not (self.keep_missing or self.returns):
            cloud = without_missing(cloud, missing_returns(cloud.xyz), path)
        xyz, part = cloud.xyz, _part_of(name)
        check_points(xyz, str(path))
        about = self.about(f"{self.collection} {part}/{path.name}", **cloud.about)
        pose, time_s = self._motion(path)
        if self.returns:
            with naming(path):
                recovered = _recovered(xyz)
            about |= {"sensor": recovered.returns.sensor, **recovered.about()}
            pose = None if pose is None else pose @ TURNED  # as in `_recovered`
            returns = recovered.returns
            return Scene(name, part, returns=returns, about=about, pose=pose, time_s=time_s)
        scene, origin = replace(cloud.checked(), about=about), (0.0, 0.0, 0.0)
        return Scene(name, part, None, scene, None, origin, None, about, pose, time_s)

    def read(self, path: Path) -> UncheckedCloud:
        """Return all points of a frame's file, also those that stand for missing returns."""
        return cloud_of_rows(frame_rows(path))

    @cached_property
    def _motions(self) -> dict[Path, tuple[Floats | None, Floats | None]]:
        return {}

    def _motion(self, frame: Path) -> tuple[Floats | None, float | None]:
        """Return the pose (4, 4) and the time in s of an odometry frame; None for other frames."""
        sequence = frame.parent.parent
        if sequence not in self._motions:
            self._motions[sequence] = _sequence_motion(sequence)
        poses, times = self._motions[sequence]
        number = int(frame.stem) if frame.stem.isdecimal() else -1
        for file, values in (("poses", poses), ("times", times)):
            if values is not None and not 0 <= number < len(values):
                raise InputError(f"{frame}: {len(values)} {file}, none for this frame")
        pose = None if poses is None else poses[number]
        return pose, None if times is None else float(times[number])

    def counts(self) -> list[Count]:
        scene_parts = [_part_of(name) for name in self._whole().names()]
        parts = [part for part in sorted(set(scene_parts)) if part in _PUBLISHED]
        return [Count(part, scene_parts.count(part), _PUBLISHED[part]) for part in parts]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        places = (path for layout in _LAYOUTS for path in sorted(folder.glob(layout)))
        folders = {_part(path): path for path in places}
        table = {
            f"{part}_{frame[:-4]}": folders[part] / frame
            for part in sorted(select_names("parts", self.parts, list(folders)) if folders else [])
            for frame in _frames(folders[part])[:: self.every]
        }
        if not table:
            raise self.missing("frames (.bin)")
        return table


def _recovered(xyz: Floats) -> RecoveredReturns:
    from puck.recordings.rings import recovered_returns, split_rings

    turned = np.column_stack([-xyz[:, 1], xyz[:, 0], xyz[:, 2]])
    azimuths = np.arctan2(xyz[:, 1], xyz[:, 0])
    rings = split_rings(azimuths + 2 * np.pi * np.signbit(azimuths))  # -0.0 ends a ring
    if len(rings) != _RINGS:
        fault = "not a whole frame in its own order, from which returns can be recovered"
        raise InputError(f"{len(rings)} rings, not {_RINGS}: {fault}")
    return recovered_returns(turned, rings, _STEP_DEG, "HDL-64E")


def _sequence_motion(sequence: Path) -> tuple[Floats | None, Floats | None]:
    poses, times, calibration = _motion_files(sequence)
    seconds = read_times(times) if times.is_file() else None
    if sequence.parent.name != "sequences" or not poses.is_file():
        return None, seconds
    camera = read_kitti_calibration(calibration)
    return np.linalg.inv(camera) @ read_poses(poses)[1] @ camera, seconds


def _motion_files(sequence: Path) -> tuple[Path, Path, Path]:
    poses = sequence.parents[1] / "poses" / f"{sequence.name}.txt"
    of_semantic = sequence / "poses.txt"  # SemanticKITTI's
    poses = poses if poses.is_file() or not of_semantic.is_file() else of_semantic
    return poses, sequence / "times.txt", sequence / "calib.txt"


def _part(folder: Path) -> str:
    return safe_name((folder if folder.name == "velodyne" else folder.parent).parent.name)


def _part_of(name: str) -> str:
    return name.rpartition("_")[0]


def _frames(folder: Path) -> list[str]:
    names = sorted(entry.name for entry in os.scandir(folder))
    return [name for name in names if name.endswith(".bin") and not name.startswith(".")]
