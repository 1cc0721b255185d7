from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cloud_files.clouds import checked_cloud, removal_counts
from pointkit.errors import InputError
from pointkit.geometry.cloud import check_extent
from puckbench.scene_sets.base import PointRemoval, look_up
from puckbench.scene_sets.recordings import BAG_SUFFIXES, RecordingSet
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name

CODE = ("puckbench.scene_sets.recordings",)


@LOADERS.register("recorded_clouds")
class RecordedClouds(RecordingSet, PointRemoval):
    """The scenes are clouds (PointCloud2) in ROS bags (.bag, .db3, .mcap), in metres.

    All attributes are kept. Scenes are named after the file and the message's number in the topic,
    from 0 (drive_0012). Unusable bags are left out and reported.
    """

    suffixes = BAG_SUFFIXES

    def load(self, name: str) -> Scene:
        from puckbench.recordings.cloud_messages import cloud_topic, read_recorded_cloud

        path, number = self._place(name)
        topic, _ = cloud_topic(path, self.topic)
        if number is None:
            raise InputError(f"{path}: topic {topic} has no message")
        if number % self.every:
            look_up(self._clouds, name, str(self.path))
        options = (topic, self.keep_missing, self.drop_invalid)
        cloud = checked_cloud(read_recorded_cloud(path, number, *options), path)
        check_extent(cloud.xyz, str(path))
        about = {"source": path.name, "topic": topic, "message": number}
        about |= removal_counts(cloud.about)
        group, time_s = safe_name(path.stem), cloud.about["stamp_s"]
        cloud = replace(cloud, about=about)
        return Scene(name, group, cloud=cloud, about=about, time_s=time_s)

    def _numbers(self, path: Path) -> range:
        from puckbench.recordings.cloud_messages import cloud_topic

        _, (_, count) = cloud_topic(path, self.topic)
        return range(0, count, self.every)
