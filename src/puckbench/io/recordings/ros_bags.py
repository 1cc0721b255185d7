"""ROS 2 bags (.db3) of velodyne_msgs/VelodyneScan messages, read without ROS.

A bag is an SQLite data base of serialised messages. The serialisation is CDR (OMG CDR, as DDS uses
it): a four-byte header that tells the byte order, then the members, each aligned to its size.
"""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.io.recordings.packet_log import PacketLog
from puckbench.lidar.recordings.packets import PACKET_BYTES

SQLITE = b"SQLite format 3\x00"
_MESSAGE = "velodyne_msgs/msg/VelodyneScan"
_TOPICS = "SELECT id, name FROM topics WHERE type = ? ORDER BY name"
_SCANS = "SELECT data FROM messages WHERE topic_id = ? ORDER BY timestamp, id"
# Time stamp (s, ns), payload, and two bytes up to the alignment of the next stamp.
_STRIDE = 8 + PACKET_BYTES + 2


def read_ros2bag(path: Path) -> PacketLog:
    """Data packets of the bag's VelodyneScan messages, in the order of the messages.

    Raises InputError when the file is no bag, is damaged, or has no or several such topics.
    """
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path))}?immutable=1", uri=True)) as bag:
            topics = bag.execute(_TOPICS, (_MESSAGE,)).fetchall()
            scans = [_scan(row[0]) for row in bag.execute(_SCANS, _only_topic(topics))]
    except (sqlite3.Error, UnicodeError) as error:
        raise InputError(f"not a readable ROS 2 bag ({error})") from error
    if not scans:
        raise InputError("the ROS 2 bag has no message of a VLP-16")
    packets = np.concatenate(scans)
    received = packets["seconds"] + packets["nanoseconds"] * 1e-9
    about = {"format": "ros2bag", "topic": str(topics[0][1]), "messages": len(scans)}
    return PacketLog(packets["payload"], received, about)


def packets_of_scan(message: bytes) -> NDArray[Any]:
    """Packets of one serialised VelodyneScan: seconds, nanoseconds, payload (1206) of each.

    Raises InputError when the message is cut short or no CDR.
    """
    if len(message) < 20 or message[:2] not in (b"\x00\x00", b"\x00\x01"):
        raise InputError("a VelodyneScan message is not plain CDR")
    order = "<" if message[1] else ">"
    # Offsets count from the end of the CDR header: stamp, frame_id, then the packets' count.
    body = message[4:]
    length: int = struct.unpack_from(order + "I", body, 8)[0]
    at = _aligned(12 + length)
    if at + 4 > len(body):
        raise InputError("a VelodyneScan message is cut short")
    count: int = struct.unpack_from(order + "I", body, at)[0]
    # The last packet may lack the bytes of alignment.
    padded = body[at + 4 :] + b"\x00\x00"
    if count * _STRIDE > len(padded):
        raise InputError(f"a VelodyneScan message of {count} packets is cut short")
    kind = [
        ("seconds", order + "i4"),
        ("nanoseconds", order + "u4"),
        ("payload", "u1", PACKET_BYTES),
        ("gap", "u1", 2),
    ]
    return np.frombuffer(padded, dtype=np.dtype(kind), count=count)


def _scan(data: object) -> NDArray[Any]:
    if not isinstance(data, bytes):
        raise InputError("a message of the ROS 2 bag is no byte string")
    return packets_of_scan(data)


def _only_topic(topics: list[Any]) -> tuple[int]:
    if len(topics) != 1:
        names = ", ".join(str(name) for _, name in topics) or "none"
        raise InputError(f"the ROS 2 bag must have one topic of {_MESSAGE} (found: {names})")
    return (topics[0][0],)


def _aligned(at: int) -> int:
    return -(-at // 4) * 4
