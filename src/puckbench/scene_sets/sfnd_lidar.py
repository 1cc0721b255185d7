"""Turns of an HDL-64E in Udacity's course of sensor fusion: PCD files in KITTI's order of points.

References
----------
github.com/udacity/SFND_Lidar_Obstacle_Detection, ``src/sensors/data/pcd``: x (forward), y (left)
and z (up) in whole millimetres, and intensity, as float32.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cloud_files.clouds import read_unchecked_cloud
from pointkit.geometry.cloud import UncheckedCloud
from puckbench.scene_sets.base import Count, select_names
from puckbench.scene_sets.kitti import Kitti
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import safe_name

CODE = ("puckbench.scene_sets.kitti",)

_LAYOUTS = ("data_*", "src/sensors/data/pcd/data_*")  # as downloaded, and a clone
_PUBLISHED = {"data_1": 22, "data_2": 154}


@LOADERS.register("sfnd_lidar")
class SfndLidar(Kitti):
    """The scenes are turns of an HDL-64E on a car, of Udacity's course of sensor fusion, in metres.

    The folder contains ``data_1`` (22 consecutive turns) or ``data_2`` (154), or is a clone of
    SFND_Lidar_Obstacle_Detection. Scenes are named data_1_0000000000 and grouped by folder. The
    files have no laser numbers and no times, but the points are in the order of KITTI's frames,
    laser by laser: the option `returns` recovers the sensor's returns as for KITTI. Intensity is
    ignored. Scenes have no poses. Each file ends with a point at (0, 0, 0), which its conversion
    left and this loader drops. The last turn of ``data_2`` is cut off, and has no returns.
    """

    licence = "none stated by Udacity; if of KITTI, as it seems, CC BY-NC-SA 3.0"
    credit = "Udacity, SFND_Lidar_Obstacle_Detection"
    expected = "expected data_1 or data_2; download: puckbench data sfnd_lidar_1 sfnd_lidar_2"
    collection = "SFND_Lidar_Obstacle_Detection"

    def read(self, path: Path) -> UncheckedCloud:
        xyz = read_unchecked_cloud(path, keep_missing=True).xyz
        left = int(len(xyz) > 0 and not xyz[-1].any())
        return UncheckedCloud(xyz[: len(xyz) - left], about={"dropped_points": left})

    def counts(self) -> list[Count]:
        names = self._whole().names()
        held = {part: sum(name.startswith(f"{part}_") for name in names) for part in _PUBLISHED}
        return [Count(part, held[part], _PUBLISHED[part]) for part in _PUBLISHED if held[part]]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        places = [path for layout in _LAYOUTS for path in sorted(folder.glob(layout))]
        folders = {safe_name(path.name): path for path in places}
        table = {
            f"{part}_{frame.stem}": frame
            for part in sorted(select_names("parts", self.parts, list(folders)) if folders else [])
            for frame in sorted(folders[part].glob("[0-9]*.pcd"))[:: self.every]
        }
        if not table:
            raise self.missing("turns (.pcd)")
        return table
