from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pointkit.errors import InputError
from pointkit.geometry.cloud import check_extent
from puckbench.scene_sets.base import look_up
from puckbench.scene_sets.recordings import RecordingSet
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name

CODE = ("puckbench.scene_sets.recordings",)


@LOADERS.register("capture_tables")
class CaptureTables(RecordingSet):
    """The scenes are turns in tables of `puckbench capture` (.parquet), in metres.

    Points have the laser, the time and, if known, the reflectivity. Scenes are named after the file
    and the turn (drive_0012). Turns that are cut off where the recording begins or ends are not
    used, unless there is no other.
    """

    suffixes = (".parquet",)

    def load(self, name: str) -> Scene:
        from pointkit.lidar.return_table import read_return_table
        from puckbench.recordings.table_turns import cloud_of_table, turn_of_table, whole_turns

        path, number = self._place(name)
        table = read_return_table(path)
        if number is None:
            raise InputError(f"{path}: has no return")
        if number not in whole_turns(table)[:: self.every]:
            look_up(self._clouds, name, str(self.path))
        turn = turn_of_table(table, number)
        cloud, time_s = cloud_of_table(turn), float(turn["timestamp"].min())
        check_extent(cloud.xyz, str(path))
        about = {"source": path.name, "turn": number, "sensor": table.about.get("sensor", "")}
        group, cloud = safe_name(path.stem), replace(cloud, about=about)
        return Scene(name, group, cloud=cloud, about=about, time_s=time_s)

    def _numbers(self, path: Path) -> list[int]:
        from pointkit.lidar.return_table import read_return_table
        from puckbench.recordings.table_turns import tell_cut_turns, whole_turns

        table = read_return_table(path)
        tell_cut_turns(path, table)
        return whole_turns(table)[:: self.every]
