"""ROS bags of Velodyne messages: SQLite by hand, MCAP from its specification, others by rosbags."""

from __future__ import annotations

import bz2
import shutil
import sqlite3
import struct
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from puck.recordings.packets import MESSAGES, SCAN
from tests.support.capture_lookalike import box_capture, scan_message

TOPIC = "/velodyne_packets"
LOG = box_capture(2)
MESSAGE = scan_message(LOG.payloads)
MAGIC = b"\x89MCAP0\r\n"


def sqlite_bag(
    path: Path,
    messages: Iterable[bytes] = (MESSAGE,),
    topics: Sequence[tuple[str, str]] = ((TOPIC, SCAN),),
    tables: str | None = None,
) -> None:
    """A bag of ROS 2 in SQLite; `tables` is a script that makes other tables."""
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            tables
            or "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
            " serialization_format TEXT, offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
            " data BLOB);"
        )
        if tables is None:
            rows = [(k, *topic) for k, topic in enumerate(topics, 1)]
            database.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", rows)
            stored = [(None, 1, 10 + k, message) for k, message in enumerate(messages)]
            database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", stored)
        database.commit()


def bag_with_log(path: Path) -> None:
    """A bag whose message stands in the write-ahead log beside it, as after a crash."""
    with closing(sqlite3.connect(path.with_suffix(".making"))) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        database.execute("CREATE TABLE messages(id, topic_id, timestamp, data BLOB)")
        database.execute("INSERT INTO topics VALUES (1, ?, ?)", (TOPIC, SCAN))
        database.commit()
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        database.execute("INSERT INTO messages VALUES (1, 1, 10, ?)", (MESSAGE,))
        database.commit()
        shutil.copyfile(path.with_suffix(".making"), path)
        shutil.copyfile(f"{path.with_suffix('.making')}-wal", f"{path}-wal")


def ros2_bag(folder: Path, storage: str, compression: str | None = None, files: int = 1) -> None:
    """A bag folder with metadata, of one or two messages in as many files."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(folder, version=8, storage_plugin=StoragePlugin[storage])
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        writer.write(_connection(writer, ros1=False), 10, MESSAGE)
    if files == 2:
        _split(folder)


def _split(folder: Path) -> None:
    """Let the metadata name the file twice: the second is a copy, as of a bag that was split."""
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    other = file.with_name(f"second{file.suffix}")
    shutil.copyfile(file, other)
    metadata = folder / "metadata.yaml"
    line = f"  - {file.name}\n"
    metadata.write_text(metadata.read_text().replace(line, line + f"  - {other.name}\n"))


def ros1_bag(path: Path, compression: str | None = None) -> None:
    """A bag of ROS 1."""
    from rosbags.rosbag1 import Writer

    writer = Writer(path)
    if compression is not None:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        writer.write(_connection(writer, ros1=True), 10, ros1_message())


def ros1_message() -> bytes:
    """The packets as ROS 1 serialises their message."""
    parts = [struct.pack("<IIII8sI", 0, 5, 250_000_000, 8, b"velodyne", len(LOG.payloads))]
    for number, payload in enumerate(LOG.payloads):
        parts += [struct.pack("<II", 5 + number, 250_000_000), payload.tobytes()]
    return b"".join(parts)


def _connection(writer: Any, ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in MESSAGES.items():
        types.register(get_types_from_msg(text, name))
    return writer.add_connection(TOPIC, SCAN, typestore=types)


def bz2_bomb(size: int) -> bytes:
    """Streams of bzip2 one after another that unpack to about `size` zeros, 45 bytes for 45 MB."""
    unit = 45_000_000
    return bz2.compress(bytes(unit)) * (size // unit + 1)


def ros1_record(header: dict[str, bytes], data: bytes) -> bytes:
    """A record of a bag of ROS 1: fields of its header, and its data."""
    fields = [f"{name}=".encode() + value for name, value in header.items()]
    head = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def ros1_bytes(chunk: bytes, compression: str, size: int) -> bytes:
    """A bag of ROS 1 with one compressed chunk, laid out by hand."""
    topic = {"op": b"\x07", "conn": bytes(4), "topic": TOPIC.encode()}
    about = {"topic": TOPIC, "type": "velodyne_msgs/VelodyneScan", "md5sum": "*"}
    fields = {**about, "message_definition": " "}
    data = ros1_record({name: text.encode() for name, text in fields.items()}, b"")[4:-4]
    start = b"#ROSBAG V2.0\n"
    head = {"op": b"\x03", "conn_count": struct.pack("<I", 1), "chunk_count": struct.pack("<I", 1)}
    place = len(start) + 4096
    packed = {"op": b"\x05", "compression": compression.encode(), "size": struct.pack("<I", size)}
    body = ros1_record(packed, chunk)
    index = {"op": b"\x04", "ver": struct.pack("<I", 1), "conn": bytes(4)}
    body += ros1_record({**index, "count": struct.pack("<I", 1)}, struct.pack("<III", 5, 0, 0))
    info = {"op": b"\x06", "ver": struct.pack("<I", 1), "chunk_pos": struct.pack("<Q", place)}
    times = {"start_time": bytes(8), "end_time": bytes(8), "count": struct.pack("<I", 1)}
    ending = ros1_record(topic, data) + ros1_record({**info, **times}, struct.pack("<II", 0, 1))
    first = ros1_record({**head, "index_pos": struct.pack("<Q", place + len(body))}, b"")
    return (
        start
        + first[:-4]
        + struct.pack("<I", 4096 - len(first))
        + b" " * (4096 - len(first))
        + body
        + ending
    )


def mcap_bytes(messages: Sequence[bytes] = (MESSAGE,), chunk_indices: int = 1) -> bytes:
    """An MCAP file of one chunk, laid out by hand; its index may name the chunk many times."""
    records = _mcap_record(3, struct.pack("<H", 1) + _text(SCAN) + _text("ros2msg") + _text("x"))
    channel = struct.pack("<HH", 1, 1) + _text(TOPIC) + _text("cdr") + struct.pack("<I", 0)
    records += _mcap_record(4, channel)
    inside = records
    for number, message in enumerate(messages):
        inside += _mcap_record(5, struct.pack("<HIQQ", 1, number, 10 + number, 10) + message)
    times = struct.pack("<QQ", 10, 10 + len(messages))
    chunk = _mcap_record(6, times + struct.pack("<QI", len(inside), 0) + _text("") + _sized(inside))
    start = MAGIC + _mcap_record(1, _text("ros2") + _text("hand"))
    entries = struct.pack("<QQ", 10, 0) * len(messages)
    index = _mcap_record(7, struct.pack("<HI", 1, len(entries)) + entries)
    place = struct.pack("<QQ", len(start), len(chunk))
    offsets = struct.pack("<IHQQ", 10, 1, len(start) + len(chunk), len(index))
    sizes = _text("") + struct.pack("<QQ", len(inside), len(inside))
    listed = _mcap_record(8, times + place + offsets + sizes) * chunk_indices
    data = start + chunk + index
    end = _mcap_record(2, struct.pack("<QQI", len(data), 0, 0))
    return data + records + listed + end + MAGIC


def _mcap_record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _sized(content: bytes) -> bytes:
    return struct.pack("<Q", len(content)) + content
