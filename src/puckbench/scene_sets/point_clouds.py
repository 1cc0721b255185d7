from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from cloud_files.clouds import SUFFIXES, checked_cloud, read_unchecked_cloud, removal_counts
from cloud_files.content import plain_name, plain_suffix
from cloud_files.ply import has_faces
from cloud_files.poses import read_times
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, check_extent
from puckbench.geometry.attributes import OF_FILE, attribute_names
from puckbench.scene_sets.base import PointRemoval
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene
from puckbench.scene_sets.user_files import TIMES_FILE, FileSet

CODE = (*("puckbench.scene_sets.user_files", "puckbench.geometry.attributes", "cloud_files.poses"),)


@LOADERS.register("point_clouds")
class PointClouds(FileSet, PointRemoval):
    """The scenes are the user's cloud files: PLY, PCD, LAS, LAZ, E57, text, NumPy and KITTI.

    Text files are XYZ, CSV, TXT, ASC and PTS. Colours, intensity and all other attributes are kept.
    All files are read before a run. Invalid ones are left out and reported. Frames whose names are
    numbers (000000.pcd) have the times of the lines of ``times.txt`` in their folder, as
    ``puckbench export --format`` writes them.
    """

    of_clouds: ClassVar[bool] = True
    read_first: ClassVar[bool] = True
    suffixes = SUFFIXES
    what = "point clouds"

    bin_columns: str | None = None
    """Columns of .bin files (KITTI): a number (3 to 6) or names (``x,y,z,intensity,ring``); by
    default inferred from the values."""

    def files(self, name: str) -> list[Path]:
        path = self.file_of(name)
        times = _times_of(path)
        return [path] if times is None else [path, times]

    def load(self, name: str) -> Scene:
        path = self.file_of(name)
        unit = self.unit_of(path)  # one that is named counts more than that of the file
        options = (self.keep_missing, self.drop_invalid, self.bin_columns)
        unchecked = read_unchecked_cloud(path, *options, convert=unit == 1)
        about = {
            **self.about(path),
            "file_bytes": path.stat().st_size,
            **removal_counts(unchecked.about),
        }
        cloud = checked_cloud(unchecked, path)
        if names := attribute_names(cloud):
            about[OF_FILE] = ", ".join(names)
        if unit != 1:
            cloud = replace(cloud, xyz=cloud.xyz * unit)
        check_extent(cloud.xyz, str(path))
        cloud, time_s = replace(cloud, about=about), self._time_s(path)
        return Scene(name, self.group_of(path), cloud=cloud, about=about, time_s=time_s)

    @cached_property
    def _seconds(self) -> dict[Path, Floats]:
        """Times of frames, by their file."""
        return {}

    def _time_s(self, frame: Path) -> float | None:
        times = _times_of(frame)
        if times is None:
            return None
        if times not in self._seconds:
            self._seconds[times] = read_times(times)
        seconds, number = self._seconds[times], int(plain_name(frame).stem)
        if number >= len(seconds):
            raise InputError(f"{frame}: {times.name} has {len(seconds)} times, none for this frame")
        return float(seconds[number])

    def takes(self, path: Path) -> bool:
        return plain_suffix(path) != ".ply" or not has_faces(path)


def _times_of(frame: Path) -> Path | None:
    """Return the file with the times of the frames in a frame's folder, or None without one."""
    times = frame.with_name(TIMES_FILE)
    return times if plain_name(frame).stem.isdecimal() and times.is_file() else None
