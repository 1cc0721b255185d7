from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
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
from puck.recordings.ouster_bags import has_metadata, lidar_topics
from puck.recordings.packets import SCAN
from puck.recordings.point_cloud2 import POINT_CLOUD2, point_columns
from puck.recordings.ros_bags import is_bag, read_messages, read_topics
from puck.recordings.topics import Topic, choose_topic

CLOUD_KINDS = (POINT_CLOUD2, COMPRESSED_POINT_CLOUD2)
_SMALLEST_M, _LARGEST_M, _MOSTLY = 1e-6, 1e8, 0.9
"""Smallest and largest usual magnitude of coordinates, in m, and the least share of coordinates
that have such magnitudes if their bytes are read in the right order. In the wrong order, about a
sixth has them by chance."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class CloudMessage:
    """A message of a ROS bag that contains a cloud.

    Parameters
    ----------
    columns
        Values of the points, (n,), by name of the field.
    stamp_ns
        Time in the message's header, in ns.
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
    """Return whether a file is a ROS bag of clouds.

    Parameters
    ----------
    path
        The file; for files that are no bags, the result is false.
    topic
        Topic whose messages must be clouds. If it is None or not in the bag, the bag must have a
        topic of clouds, and no topic of a sensor's packets. Packets of an Ouster without the
        sensor's metadata do not count.
    """
    if not is_bag(path):
        return False
    topics = read_topics(path)
    if topic in topics:
        return topics[topic].kind in CLOUD_KINDS
    kinds = {each.kind for each in topics.values()}
    has_packets = SCAN in kinds or (lidar_topics(topics) and has_metadata(topics))
    return not has_packets and not kinds.isdisjoint(CLOUD_KINDS)


def cloud_topic(path: Path, topic: str | None = None) -> tuple[str, Topic]:
    """Return the name and the properties of a topic of clouds.

    Parameters
    ----------
    path
        A ROS bag.
    topic
        Name of the topic; by default, the only topic of clouds in the bag.

    Raises
    ------
    InputError
        The topic has no clouds, or `topic` is None and the bag has several topics of clouds.
    """
    with naming(path):
        topics = read_topics(path)
        name = choose_topic(topics, CLOUD_KINDS, topic)
    return name, topics[name]


def read_cloud_messages(
    path: Path, topic: str | None, numbers: Sequence[int], source: Path | None = None
) -> list[CloudMessage]:
    """Read messages from a topic of clouds.

    Parameters
    ----------
    path
        A ROS bag.
    topic
        Name of the topic; None for the only topic of clouds.
    numbers
        Numbers of the messages to read, from 0, in increasing order.
    source
        File that messages name, if `path` is a temporary copy of it.

    Returns
    -------
    list
        The messages, in the order of `numbers`.
    """
    definitions = {COMPRESSED_POINT_CLOUD2: DEFINITION}
    bag = read_messages(path, CLOUD_KINDS, definitions, topic, numbers)
    columns_of = point_columns if bag.kind == POINT_CLOUD2 else decompressed_columns
    clouds = []
    for number, message in zip(numbers, bag.messages, strict=True):
        with naming(f"{source or path}: topic {bag.topic}: message {number}"):
            columns = columns_of(message)
            if not _are_plausible(columns):
                swapped = columns_of(replace(message, is_bigendian=not message.is_bigendian))
                if _are_plausible(swapped):
                    _tell_byte_order(f"{source or path}: topic {bag.topic}")
                    columns = swapped
        stamp, frame = message.header.stamp, message.header.frame_id.lstrip("/")
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        clouds.append(CloudMessage(columns, stamp_ns, frame, message.height > 1))
    return clouds


def _are_plausible(columns: Columns) -> bool:
    """Return whether coordinates have usual magnitudes, as those of exchanged bytes do not."""
    axes = [np.abs(columns[axis]) for axis in "xyz" if axis in columns]
    sizes = np.concatenate([axis[np.isfinite(axis) & (axis > 0)] for axis in axes] or [np.zeros(0)])
    is_usual = (sizes > _SMALLEST_M) & (sizes < _LARGEST_M)
    return not len(sizes) or float(is_usual.mean()) > _MOSTLY


@cache
def _tell_byte_order(label: str) -> None:
    _log.warning("%s: the order of bytes is not that of the field is_bigendian: exchanged", label)


def read_recorded_cloud(
    path: Path,
    number: int,
    topic: str | None = None,
    keep_missing: bool = False,
    drop_invalid: bool = False,
    source: Path | None = None,
) -> UncheckedCloud:
    """Read one message of a ROS bag as a cloud.

    Parameters
    ----------
    path
        A ROS bag.
    number
        Number of the message in its topic, from 0.
    topic
        Topic of clouds; by default, the only one.
    keep_missing
        Whether to keep missing returns, which are stored as points at the origin or without
        coordinates.
    drop_invalid
        Whether to leave out points with a coordinate that is infinite or not a number.
    source
        File that messages name, if `path` is a temporary copy of it.

    Returns
    -------
    UncheckedCloud
        The cloud, which may have no points or, unless `drop_invalid`, points that are not finite.
        Its description has the time stamp of the message in s (``stamp_s``).
    """
    (message,) = read_cloud_messages(path, topic, [number], source)
    source = source or path
    with naming(source):
        cloud = cloud_from_columns(message.columns)
    cloud = replace(cloud, about={**cloud.about, "stamp_s": message.stamp_ns / 1e9})
    if not keep_missing and len(cloud):
        missing = missing_returns(cloud.xyz, message.is_organised)
        if drop_invalid or np.isfinite(cloud.xyz[~missing]).all():  # other clouds are refused
            cloud = without_missing(cloud, missing, source)
    return without_invalid(cloud, source) if drop_invalid else cloud
