"""ROS bags with clouds (PointCloud2), written by rosbags from structured arrays."""

from __future__ import annotations

import gzip
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puck.recordings.compressed_point_cloud2 import COMPRESSED_POINT_CLOUD2, DEFINITION
from puck.recordings.point_cloud2 import POINT_CLOUD2

FORMATS = ("bag", "db3", "mcap")
NUMBERS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
Rows = NDArray[Any]


def cloud_bag(
    path: Path,
    topics: Mapping[str, Sequence[Rows]],
    stamps_s: Sequence[float] = (),
    others: Mapping[str, str] | None = None,
    is_compressed: bool = False,
    frames: Sequence[str] = (),
    compression: str | None = None,
) -> Path:
    """Write a bag of ROS 1 (.bag) or a file of ROS 2 (.db3, .mcap); return its path.

    Each topic has the messages of structured arrays (n,) or (height, width), 0.1 s apart. `others`
    are topics of text, by name. Clouds may be compressed by zlib, as point_cloud_transport does.
    `frames` are the clouds' coordinate frames, by default "sensor". `compression` is that of
    the chunks of a ROS 1 bag (BZ2, LZ4), or what of a ROS 2 bag is compressed (STORAGE, MESSAGE).
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    is_ros1 = path.suffix == ".bag"
    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(DEFINITION, COMPRESSED_POINT_CLOUD2))
    cloud_kind = COMPRESSED_POINT_CLOUD2 if is_compressed else POINT_CLOUD2
    serialise = types.serialize_ros1 if is_ros1 else types.serialize_cdr
    with ExitStack() as stack:
        writer = stack.enter_context(_writer(path, compression))
        for topic, text in (others or {}).items():
            kind = "std_msgs/msg/String"
            other = writer.add_connection(topic, kind, typestore=types)
            writer.write(other, 5, bytes(serialise(types.types[kind](text), kind)))
        for topic, clouds in topics.items():
            connection = writer.add_connection(topic, cloud_kind, typestore=types)
            for number, rows in enumerate(clouds):
                stamp = stamps_s[number] if stamps_s else 1e9 + 0.1 * number
                frame = frames[number] if frames else "sensor"
                message = cloud_message(types, rows, nanoseconds(stamp), is_ros1, frame)
                if is_compressed:
                    message = compressed_message(types, message)
                data = bytes(serialise(message, cloud_kind))
                writer.write(connection, 10 + 100 * number, data)
    if not is_ros1:
        (file,) = path.with_suffix(".making").glob(f"*{path.suffix}")
        file.rename(path)
    return path


def nanoseconds(seconds: float) -> int:
    return int(seconds // 1) * 10**9 + round(seconds % 1 * 1e9)


def _writer(path: Path, compression: str | None) -> Any:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    if path.suffix == ".bag":
        writer1 = Writer1(path)
        if compression is not None:
            writer1.set_compression(Writer1.CompressionFormat[compression])
        return writer1
    storage = {".db3": StoragePlugin.SQLITE3, ".mcap": StoragePlugin.MCAP}[path.suffix]
    writer = Writer2(path.with_suffix(".making"), version=8, storage_plugin=storage)
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    return writer


def cloud_message(
    types: Any, rows: Rows, stamp_ns: int, is_ros1: bool, frame: str = "sensor"
) -> Any:
    rows = np.atleast_2d(rows)
    fields = []
    for name in rows.dtype.names or ():
        kind, offset = (rows.dtype.fields or {})[name][:2]
        number = NUMBERS[kind.base.newbyteorder("=").str[1:]]
        field = types.types["sensor_msgs/msg/PointField"]
        fields.append(field(name, offset, number, int(np.prod(kind.shape, dtype=int))))
    time = types.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    more = {"seq": 0} if is_ros1 else {}
    header = types.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **more)
    steps = (rows.itemsize, rows.itemsize * rows.shape[1])
    data = np.frombuffer(rows.tobytes(), np.uint8)
    return types.types[POINT_CLOUD2](header, *rows.shape, fields, False, *steps, data, True)


def compressed_message(types: Any, message: Any) -> Any:
    data = np.frombuffer(gzip.compress(message.data.tobytes()), np.uint8)
    size = (message.height, message.width)
    layout = (message.fields, message.is_bigendian, message.point_step, message.row_step)
    kind = types.types[COMPRESSED_POINT_CLOUD2]
    return kind(message.header, *size, *layout, data, True, "zlib")
