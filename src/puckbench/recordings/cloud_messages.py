from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cloud_files.clouds import without_invalid, without_missing
from cloud_files.missing_returns import missing_returns
from cloud_files.point_columns import cloud_from_columns
from pointkit.errors import naming
from pointkit.geometry.cloud import UncheckedCloud
from pointkit.isolated import Columns
from puck.recordings.compressed_point_cloud2 import (
    COMPRESSED_POINT_CLOUD2,
    DEFINITION,
    decompressed_columns,
)
from puck.recordings.packets import SCAN
from puck.recordings.point_cloud2 import POINT_CLOUD2, point_columns
from puck.recordings.ros_bags import is_bag, read_messages, read_topics
from puck.recordings.topics import Topic, choose_topic

CLOUD_KINDS = (POINT_CLOUD2, COMPRESSED_POINT_CLOUD2)


@dataclass(frozen=True)
class CloudMessage:
    """A message with a cloud.

    Parameters
    ----------
    columns
        Arrays (n,) by the names of the points' fields.
    stamp_ns
        Time in the message's header, ns.
    frame
        Name of the coordinate frame.
    is_organised
        Whether the points form an image with several rows.
    """

    columns: Columns
    stamp_ns: int
    frame: str
    is_organised: bool


def has_clouds(path: Path, topic: str | None = None) -> bool:
    """Return whether a bag has clouds, in the given topic, or else in any and no packets."""
    if not is_bag(path):
        return False
    topics = read_topics(path)
    if topic in topics:
        return topics[topic].kind in CLOUD_KINDS
    kinds = {each.kind for each in topics.values()}
    return SCAN not in kinds and not kinds.isdisjoint(CLOUD_KINDS)


def cloud_topic(path: Path, topic: str | None = None) -> tuple[str, Topic]:
    """Return the name and the properties of a topic of clouds, by default of the only one.

    Raises InputError if the topic is not one of clouds, or if the bag has several.
    """
    with naming(path):
        topics = read_topics(path)
        name = choose_topic(topics, CLOUD_KINDS, topic)
    return name, topics[name]


def read_cloud_messages(
    path: Path, topic: str | None, numbers: Sequence[int]
) -> list[CloudMessage]:
    """Read messages of a topic of clouds, by their numbers from 0, in increasing order."""
    definitions = {COMPRESSED_POINT_CLOUD2: DEFINITION}
    bag = read_messages(path, CLOUD_KINDS, definitions, topic, numbers)
    columns_of = point_columns if bag.kind == POINT_CLOUD2 else decompressed_columns
    clouds = []
    for number, message in zip(numbers, bag.messages, strict=True):
        with naming(f"{path}: topic {bag.topic}: message {number}"):
            columns = columns_of(message)
        stamp, frame = message.header.stamp, message.header.frame_id.lstrip("/")
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        clouds.append(CloudMessage(columns, stamp_ns, frame, message.height > 1))
    return clouds


def read_recorded_cloud(
    path: Path,
    number: int,
    topic: str | None = None,
    keep_missing: bool = False,
    drop_invalid: bool = False,
) -> UncheckedCloud:
    """Read a message as a cloud, which may be empty or have points that are not finite.

    Parameters
    ----------
    path
        A bag.
    number
        Number of the message, from 0.
    topic
        Topic of clouds; by default the only one.
    keep_missing, drop_invalid
        As for `cloud_files.clouds.read_cloud`.
    """
    (message,) = read_cloud_messages(path, topic, [number])
    with naming(path):
        cloud = cloud_from_columns(message.columns)
    if not keep_missing and len(cloud):
        missing = missing_returns(cloud.xyz, message.is_organised)
        if drop_invalid or np.isfinite(cloud.xyz[~missing]).all():  # other clouds are refused
            cloud = without_missing(cloud, missing, path)
    return without_invalid(cloud, path) if drop_invalid else cloud
