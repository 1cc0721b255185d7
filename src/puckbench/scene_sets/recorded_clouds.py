from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from weakref import finalize

from cloud_files.clouds import checked_cloud, removal_counts
from pointkit.errors import InputError
from pointkit.geometry.cloud import check_extent
from puckbench.scene_sets.base import PointRemoval, look_up
from puckbench.scene_sets.recordings import (
    BAG_SUFFIXES,
    COMPRESSED,
    RecordingSet,
    decompressed_in,
    naming_source,
)
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name

CODE = ("puckbench.scene_sets.recordings",)


@LOADERS.register("recorded_clouds")
class RecordedClouds(RecordingSet, PointRemoval):
    """The scenes are clouds (PointCloud2) in ROS bags (.bag, .db3, .mcap), in metres.

    Bags may be compressed (.puck). All attributes are kept. Scenes are named after the file and the
    number of the message in the topic, from 0 (drive_0012). Unusable bags are left out and
    reported.
    """

    suffixes = (*BAG_SUFFIXES, COMPRESSED)

    def load(self, name: str) -> Scene:
        from puckbench.recordings.cloud_messages import cloud_topic, read_recorded_cloud

        path, number = self._place(name)
        with self._bag(path) as bag:
            topic, _ = cloud_topic(bag, self.topic)
            if number is None:
                raise InputError(f"{path}: topic {topic} has no message")
            if number % self.every:
                look_up(self._clouds, name, str(self.path))
            options = (topic, self.keep_missing, self.drop_invalid, path)
            cloud = checked_cloud(read_recorded_cloud(bag, number, *options), path)
        check_extent(cloud.xyz, str(path))
        about = {"source": path.name, "topic": topic, "message": number}
        about |= removal_counts(cloud.about)
        group, time_s = safe_name(path.stem), cloud.about["stamp_s"]
        cloud = replace(cloud, about=about)
        return Scene(name, group, cloud=cloud, about=about, time_s=time_s)

    def _numbers(self, path: Path) -> range:
        from puckbench.recordings.cloud_messages import cloud_topic

        with self._bag(path) as bag:
            _, (_, count) = cloud_topic(bag, self.topic)
        return range(0, count, self.every)

    @cached_property
    def _copies(self) -> dict[Path, _Copy]:
        """The copy of the compressed bag that was read last."""
        return {}

    @contextmanager
    def _bag(self, path: Path) -> Iterator[Path]:
        """Yield the path of a bag or, if it is compressed, of a copy that this scene set keeps."""
        if path.suffix.lower() != COMPRESSED:
            yield path
            return
        if path not in self._copies:
            self._copies.clear()
            self._copies[path] = _Copy(path)
        copy = self._copies[path].path
        with naming_source(path, copy):
            yield copy


class _Copy:
    """A decompressed copy of a bag, at `path`, which is deleted with this object."""

    def __init__(self, bag: Path) -> None:
        folder = mkdtemp()
        finalize(self, rmtree, folder, ignore_errors=True)
        self.path = decompressed_in(Path(folder), bag)
