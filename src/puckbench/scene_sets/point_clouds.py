from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from cloud_files.clouds import SUFFIXES, checked_cloud, read_unchecked_cloud, removal_counts
from cloud_files.content import plain_suffix
from cloud_files.ply import has_faces
from pointkit.geometry.cloud import check_extent
from puckbench.scene_sets.base import PointRemoval
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene
from puckbench.scene_sets.user_files import FileSet

CODE = ("puckbench.scene_sets.user_files",)


@LOADERS.register("point_clouds")
class PointClouds(FileSet, PointRemoval):
    """The scenes are the user's cloud files: PLY, PCD, LAS, LAZ, E57, text, NumPy and KITTI.

    Text files are XYZ, CSV, TXT, ASC and PTS. Colours, intensity and all other attributes are kept.
    All files are read before a run. Invalid ones are left out and reported.
    """

    of_clouds: ClassVar[bool] = True
    read_first: ClassVar[bool] = True
    suffixes = SUFFIXES
    what = "point clouds"

    bin_columns: str | None = None
    """Columns of .bin files (KITTI): a number (3 to 6) or names (``x,y,z,intensity,ring``); by
    default inferred from the values."""

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
        if unit != 1:
            cloud = replace(cloud, xyz=cloud.xyz * unit)
        check_extent(cloud.xyz, str(path))
        return Scene(name, self.group_of(path), cloud=replace(cloud, about=about), about=about)

    def takes(self, path: Path) -> bool:
        return plain_suffix(path) != ".ply" or not has_faces(path)
