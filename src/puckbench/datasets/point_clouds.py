"""A user's own point clouds, of every format that is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from puckbench.core.errors import InputError
from puckbench.datasets.files import FileSet
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene
from puckbench.geometry.cloud import PointCloud, check_points
from puckbench.io.clouds import SUFFIXES, read_points
from puckbench.io.ply import has_faces


@LOADERS.register("point_clouds")
class PointClouds(FileSet):
    """Clouds in PLY, PCD, LAS, LAZ, E57, text (XYZ, CSV, TXT, ASC, PTS), NumPy and KITTI files.

    Colours, intensity and all other values of the points are kept in the cloud's PLY. All files are
    read before a run: what cannot be used is left out and named.
    """

    of_clouds: ClassVar[bool] = True
    read_first: ClassVar[bool] = True
    suffixes = SUFFIXES
    what = "point clouds"

    drop_invalid: bool = False
    """Whether points that are not finite are left out and counted; else their cloud is not used."""

    def load(self, name: str) -> Scene:
        """Read the cloud, in metres; `about` has the number of points that were left out."""
        path = self._file(name)
        cloud = read_points(path)
        about = self._about(path)
        if self.drop_invalid:
            finite = cloud.finite()
            about["dropped_points"] = len(cloud) - len(finite)
            cloud = finite
        _check(cloud, path)
        if (unit := self._unit(path)) != 1:
            cloud = replace(cloud, xyz=cloud.xyz * unit)
        return Scene(name, self._group(path), cloud=replace(cloud, about=about), about=about)

    def _takes(self, path: Path) -> bool:
        return path.suffix.lower() != ".ply" or not has_faces(path)


def _check(cloud: PointCloud, path: Path) -> None:
    check_points(cloud.xyz, str(path))
    if not np.ptp(cloud.xyz, axis=0).any():
        raise InputError(f"{path}: the cloud has no extent: all its points are the same")
