from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pointkit.geometry.cloud import UncheckedCloud
from puckbench.jobs.prepare import Prepare
from puckbench.jobs.registry import JOBS
from puckbench.recordings.cloud_messages import read_recorded_cloud


@JOBS.register("prepare_message")
class PrepareMessage(Prepare):
    """Prepare a cloud for coding, as `Prepare` does, from a message of a ROS bag.

    Parameters
    ----------
    message
        Number of the message among those of the topic, counted from 0.
    topic
        Topic of the message; by default the bag's only topic with clouds.
    """

    message: int
    topic: str | None = None

    def _cloud(self, path: Path) -> UncheckedCloud:
        options = (self.keep_missing, self.drop_invalid)
        cloud = read_recorded_cloud(path, self.message, self.topic, *options)
        return replace(cloud, about={"source": path.name, "message": self.message, **cloud.about})
