"""Packets and metadata of Ouster sensors in ROS bags of their driver."""

from __future__ import annotations

from pathlib import Path

from pointkit.errors import InputError
from puck.recordings.ouster import OusterSensor, sensor_beside, sensor_of
from puck.recordings.ouster_logs import ouster_log
from puck.recordings.packets import PacketLog
from puck.recordings.ros_bags import read_messages, read_topics
from puck.recordings.topics import Topics, choose_topic

PACKET_MESSAGES = (
    "ouster_sensor_msgs/msg/PacketMsg",
    "ouster_ros/msg/PacketMsg",
    "ouster_msgs/msg/PacketMsg",
)
"""Types of the ROS messages that hold one packet each."""
_DEFINITIONS = dict.fromkeys(PACKET_MESSAGES, "uint8[] buf")
_STRING = "std_msgs/msg/String"
_LIDAR, _METADATA = "lidar_packets", "metadata"
"""Parts of the driver's names of topics."""


def lidar_topics(topics: Topics) -> Topics:
    """Return the topics of an Ouster's lidar packets; others of the same type have IMU packets."""
    of_packets = {name: each for name, each in topics.items() if each.kind in PACKET_MESSAGES}
    return {name: each for name, each in of_packets.items() if _LIDAR in name} or of_packets


def has_metadata(topics: Topics) -> bool:
    """Return whether a bag has a topic of an Ouster's metadata."""
    return bool(_metadata_topics(topics))


def sensors_in_bag(path: Path) -> list[OusterSensor]:
    """Return the sensors whose metadata are in a ROS bag of packets, without repeated ones.

    Raises InputError if the bag is damaged, or its metadata are not those of an Ouster.
    """
    topics = read_topics(path)
    names = _metadata_topics(topics) if lidar_topics(topics) else []
    return list(dict.fromkeys(sensor_of(_metadata(path, name), name) for name in names))


def ouster_packets_in_bag(
    path: Path, topics: Topics, source: Path, topic: str | None = None
) -> PacketLog:
    """Return the packets of an Ouster sensor in a ROS bag, with times on the sensor's clock.

    Parameters
    ----------
    path
        The bag.
    topics
        The bag's topics.
    source
        File that messages name. The sensor's metadata come from the bag, or else from a file beside
        it (see `ouster.sensor_beside`).
    topic
        Topic of the packets; by default, the only one.

    Raises
    ------
    InputError
        There is no such topic, or there are several; or the metadata are missing, or do not
        describe the packets.
    """
    name = choose_topic(lidar_topics(topics), PACKET_MESSAGES, topic)
    sensor, described = _sensor(path, name, topics, source)
    bag = read_messages(path, PACKET_MESSAGES, _DEFINITIONS, name)
    size = sensor.packet.itemsize
    # Older drivers add a byte to each packet.
    payloads = [
        each.buf[:size].tobytes() for each in bag.messages if len(each.buf) in (size, size + 1)
    ]
    described = f"{described} ({sensor.name}, {sensor.profile}, packets of {size:,} bytes)"
    if not payloads:
        sizes = ", ".join(f"{each:,}" for each in sorted({len(each.buf) for each in bag.messages}))
        what = f"packets of {sizes} bytes" if sizes else "no packet"
        raise InputError(f"topic {name} has {what}, which {described} does not describe")
    messages = len(bag.messages)
    about = {"format": bag.format, "topic": name, "messages": messages}
    if messages > len(payloads):
        about["other_packets"] = messages - len(payloads)
    return ouster_log(sensor, payloads, None, about, described)


def _sensor(path: Path, topic: str, topics: Topics, source: Path) -> tuple[OusterSensor, str]:
    names = _metadata_topics(topics)
    near = [name for name in names if name.rpartition("/")[0] == topic.rpartition("/")[0]]
    if len(found := near or names) == 1:
        return sensor_of(_metadata(path, found[0]), found[0]), found[0]
    if beside := sensor_beside(path, source):
        return beside
    raise InputError(
        f"topic {topic} has packets of an Ouster, but the bag has {len(found) or 'no'} topics of "
        f"metadata that may be its own: put them beside it ({source.stem}.json)"
    )


def _metadata_topics(topics: Topics) -> list[str]:
    return [
        name
        for name, (kind, messages) in topics.items()
        if kind == _STRING and _METADATA in name and messages
    ]


def _metadata(path: Path, topic: str) -> bytes:
    (message,) = read_messages(path, [_STRING], topic=topic, numbers=[0]).messages
    return str(message.data).encode()
