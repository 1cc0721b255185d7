"""ROS bags (ROS 1 .bag, ROS 2 .db3 and .mcap, and bag folders) as messages, read without ROS."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from puckbench.core.errors import InputError

_STARTS = {b"SQLite format 3\x00": ".db3", b"\x89MCAP0\r\n": ".mcap", b"#ROSBAG": ".bag"}
"""First bytes of each kind of bag, and its usual suffix."""


@dataclass(frozen=True)
class Messages:
    """The messages of one topic, in the order in which they were recorded; `format` of the bag."""

    topic: str
    messages: list[Any]
    format: str


def bag_format(start: bytes) -> str | None:
    """The usual suffix of the kind of bag that begins with these bytes, or None for no bag."""
    return next((suffix for magic, suffix in _STARTS.items() if start.startswith(magic)), None)


def read_messages(path: Path, kind: str, definitions: Mapping[str, str]) -> Messages:
    """Read the messages of the only topic of one type.

    Parameters
    ----------
    path
        A bag, known by its first bytes, or the folder of one.
    kind
        Type of the messages, such as ``velodyne_msgs/msg/VelodyneScan``.
    definitions
        Definitions, in ROS's own notation, of this type and of what it is made of but the standard
        types. Those in the bag are not used: they would be compiled.

    Raises
    ------
    InputError
        It is no bag, is damaged, or has no or several topics of the type.
    """
    import apsw
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from rosbags.serde import SerdeError

    damage = (
        *(Error1, Error2, SerdeError, apsw.Error, struct.error, OSError, EOFError, MemoryError),
        *(ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError),
        RuntimeError,
    )
    bag = _bag_in(path) if path.is_dir() else path
    with TemporaryDirectory() as folder:
        try:
            return _read(_linked(bag, Path(folder)), kind, definitions)
        except damage as error:
            fault = " ".join(str(error).replace(folder, "").split())[:120]
            raise InputError(f"not a readable ROS bag ({type(error).__name__}: {fault})") from error


def _read(bag: Path, kind: str, definitions: Mapping[str, str]) -> Messages:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    is_ros1 = bag.suffix == ".bag"
    types = _types(is_ros1, tuple(definitions.items()))
    decode = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
    reader: Any = Reader1(bag) if is_ros1 else Reader2(bag)
    with reader:
        chosen = [one for one in reader.connections if one.msgtype == kind]
        topics = sorted({one.topic for one in chosen})
        if len(topics) != 1:
            names = ", ".join(topics) or "none"
            raise InputError(f"the ROS bag must have one topic of {kind} (found: {names})")
        found = [decode(data, kind) for _, _, data in reader.messages(connections=chosen)]
    return Messages(topics[0], found, "rosbag" if is_ros1 else "ros2bag")


@cache
def _types(is_ros1: bool, definitions: tuple[tuple[str, str], ...]) -> Any:
    """The standard message types and the given ones, which are compiled."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name, text in definitions:
        types.register(get_types_from_msg(text, name))
    return types


def _linked(bag: Path, folder: Path) -> Path:
    """A link to the bag under the suffix of its kind, by which the library knows it.

    Nor does the library open SQLite files whose path has a ``#`` or a ``?``.
    """
    suffix = ""
    if not bag.is_dir():
        with bag.open("rb") as stream:
            suffix = bag_format(stream.read(16)) or ".bag"
    link = folder / f"bag{suffix}"
    link.symlink_to(bag.resolve())
    return link


def _bag_in(folder: Path) -> Path:
    """The bag of a folder: itself where its metadata are there, else the only file of a bag."""
    if (folder / "metadata.yaml").is_file():
        return folder
    bags = sorted(path for path in folder.iterdir() if path.suffix in _STARTS.values())
    if len(bags) != 1:
        raise InputError(f"{folder}: {len(bags)} ROS bags (.bag, .db3, .mcap), not one")
    return bags[0]
