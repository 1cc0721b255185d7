"""ROS bags: logs beside them, views, bombs, indices that overlap, other topics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from puck.recordings.packet_turns import decode_packets
from puck.recordings.packets import SCAN
from tests.support.bag_files import (
    LOG,
    MESSAGE,
    TOPIC,
    bag_with_log,
    bz2_bomb,
    mcap_bytes,
    ros1_bag,
    ros1_bytes,
    ros2_bag,
    sqlite_bag,
)
from tests.support.capture_lookalike import box_capture, scan_message
from tests.support.corpus_case import Case, content

POINTS = decode_packets(LOG.payloads).xyz
SPUN = box_capture(120).payloads
SCANS = [scan_message(SPUN[first : first + 20]) for first in range(0, 120, 20)]
Write = Callable[[Path], Any]
IMAGES = "sensor_msgs/msg/Image"
TOPICS = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT);"
NUMBERS = "WITH RECURSIVE r(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM r"
ENDLESS = "".join([TOPICS, "CREATE VIEW messages AS ", NUMBERS, ") SELECT x AS topic_id FROM r;"])
ROW = f"'{TOPIC}', '{SCAN}' FROM r;"
PRODUCT = "".join(
    [
        "CREATE TABLE topics(id, name, type); CREATE TABLE messages(topic_id, timestamp, data);",
        *("INSERT INTO topics ", NUMBERS, " LIMIT 5000) SELECT 1, ", ROW),
        *("INSERT INTO messages ", NUMBERS, " LIMIT 5000) SELECT 1, x, x'' FROM r;"),
    ]
)
"""Every message belongs to every topic."""
COMPUTED = (
    f"{TOPICS} CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER,"
    " data BLOB AS (zeroblob(1000000000)));"
)


def folder_without_a_file(path: Path) -> None:
    """Metadata name a file that is not there."""
    ros2_bag(path, "SQLITE3")
    next(path.glob("*.db3")).unlink()


def two_bags(path: Path) -> None:
    """A folder of two bags without metadata."""
    path.mkdir()
    for name in ("a.db3", "b.db3"):
        sqlite_bag(path / name)


def only_log(path: Path) -> None:
    """A bag in a folder without metadata, with its write-ahead log, as after a crash."""
    path.mkdir()
    bag_with_log(path / "a.db3")


def only_ros1(path: Path) -> None:
    """A bag of ROS 1 in a folder."""
    path.mkdir()
    ros1_bag(path / "a.bag")


def with_log_and_marks(path: Path) -> None:
    """A path with marks that addresses of databases may not have."""
    bag_with_log(path)
    assert path.name == "log #1?.db3"


def tables(script: str) -> Write:
    """Writes a database made by a script."""
    return lambda path: sqlite_bag(path, tables=script)


def topics(names: Sequence[tuple[str, str]]) -> Write:
    """Writes a bag of these topics and types; its message belongs to the first."""
    return lambda path: sqlite_bag(path, topics=names)


CASES = [
    Case("log #1?.db3", with_log_and_marks, "returns", points=POINTS),
    Case("only_ros1", only_ros1, "returns", points=POINTS),
    Case("only_log", only_log, "returns", points=POINTS),
    Case("plain.mcap", content(mcap_bytes()), "returns", points=POINTS),
    Case("bzip2.bag", lambda path: ros1_bag(path, "BZ2"), "returns", points=POINTS),
    Case("lz4.bag", lambda path: ros1_bag(path, "LZ4"), "returns", points=POINTS),
    *(
        Case(f"folder_{kind}".lower(), write, "returns", points=POINTS)
        for kind, write in {
            "sqlite": lambda path: ros2_bag(path, "SQLITE3"),
            "sqlite_files_zstd": lambda path: ros2_bag(path, "SQLITE3", "FILE"),
            "sqlite_messages_zstd": lambda path: ros2_bag(path, "SQLITE3", "MESSAGE"),
            "mcap": lambda path: ros2_bag(path, "MCAP"),
            "mcap_zstd": lambda path: ros2_bag(path, "MCAP", "STORAGE"),
        }.items()
    ),
    Case(
        "endless_view.db3",
        tables(ENDLESS),
        "returns",
        error="no plain table messages",
    ),
    Case(
        "computed.db3",
        tables(COMPUTED),
        "returns",
        error="no plain table messages",
    ),
    Case(
        "tables_of_others.db3",
        tables("CREATE TABLE a(b);"),
        "returns",
        error="no plain table topics",
    ),
    Case("product.db3", tables(PRODUCT), "returns", error=r"product.db3: .* \(interrupted"),
    Case(
        "text.db3",
        lambda path: sqlite_bag(path, ["text"]),
        "returns",
        error=r"text.db3: not a readable ROS bag \(a message that is not binary",
    ),
    Case(
        "bomb.bag",
        lambda path: path.write_bytes(ros1_bytes(bz2_bomb(5 << 30), "bz2", 100)),
        "returns",
        error="bomb.bag: not a readable ROS bag .parsing it takes more than (2 GiB|10 s)",
    ),
    Case(
        "chunk_named_often.mcap",
        content(mcap_bytes([MESSAGE] * 2, 500)),
        "returns",
        error="chunk_named_often.mcap: not a readable ROS bag .*chunks overlap",
    ),
    Case(
        "images.db3",
        topics([("/pixels\n", IMAGES), ("/tf", "tf2_msgs/msg/TFMessage")]),
        "returns",
        error=rf"one topic of {SCAN} or .*; it has /pixels\? \({IMAGES}\), /tf .*: record",
    ),
    Case(
        "many_topics.db3",
        topics([(f"/{n:03}", IMAGES) for n in range(300)]),
        "returns",
        error="/007 .*, 292 others: record",
    ),
    Case(
        "two_sensors.db3",
        topics([("/left", SCAN), ("/right", SCAN)]),
        "returns",
        error="several topics of .*: /left, /right: choose one by --topic",
    ),
    Case("no_topics.db3", topics([]), "returns", error="it has no topic"),
    Case(
        "missing_part",
        folder_without_a_file,
        "returns",
        error="missing_part: metadata.yaml names files that are not there: ",
    ),
    Case("two_bags", two_bags, "returns", error="two_bags: 2 ROS bags"),
    Case(
        "swapped_messages.db3",
        lambda path: sqlite_bag(path, [SCANS[place] for place in (0, 2, 1, 3, 5, 4)]),
        "returns",
        points=decode_packets(SPUN).xyz,
        warning="swapped_messages.db3: sorted by the sensor's clock, as 2 packets are late$",
    ),
    Case(
        "repeated_messages.db3",
        lambda path: sqlite_bag(path, [*SCANS, SCANS[2]]),
        "returns",
        points=decode_packets(SPUN).xyz,
        warning=r"left out packets that repeat one before, byte by byte \(20\)$",
    ),
    Case(
        "lost_messages.db3",
        lambda path: sqlite_bag(path, [*SCANS[:2], *SCANS[3:]]),
        "returns",
        points=decode_packets(np.delete(SPUN, np.r_[40:60], axis=0)).xyz,
        warning=r"lost_messages.db3: about 20 packets are lost \(at packet 40\)$",
    ),
]
