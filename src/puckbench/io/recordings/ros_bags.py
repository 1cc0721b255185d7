"""ROS bags (ROS 1 .bag, ROS 2 .db3 and .mcap, and bag folders) as messages, read without ROS."""

from __future__ import annotations

import shutil
import struct
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.io.isolated import Parsed, isolated
from puckbench.io.point_columns import Columns
from puckbench.io.recordings.sqlite_bags import BESIDE, StoredMessages, Topics, sqlite_storage

_STARTS = {b"SQLite format 3\x00": ".db3", b"\x89MCAP0\r\n": ".mcap", b"#ROSBAG": ".bag"}
"""First bytes of each kind of bag, and its usual suffix."""
_METADATA = "metadata.yaml"
_LISTED, _LONGEST_NAME, _LONGEST_FAULT = 8, 60, 120
_DAMAGE = (
    *(struct.error, OSError, EOFError, RuntimeError, ArithmeticError, AssertionError),
    *(AttributeError, LookupError, TypeError, ValueError),
)
"""What damaged bags make the libraries raise besides their own errors."""


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
    from rosbags.serde import SerdeError

    beside = [path.with_name(path.name + end) for end in BESIDE]
    with TemporaryDirectory() as folder:
        options = {"kind": kind, "folder": folder}
        parsed = isolated(parse_bag, path, "ROS bag", options, beside)
    topic, form = parsed.about["topic"], parsed.about["format"]
    is_ros1 = form == "rosbag"
    types = _types(is_ros1, tuple(definitions.items()))
    decode = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
    data, ends = parsed.columns["data"], accumulate(parsed.columns["sizes"].tolist(), initial=0)
    try:
        messages = [decode(data[start:end].tobytes(), kind) for start, end in pairwise(ends)]
    except (SerdeError, *_DAMAGE) as error:
        raise _damaged(path, error) from error
    return Messages(topic, messages, form)


def parse_bag(path: Path, kind: str, folder: str) -> Parsed:
    """The messages of the only topic of one type, as bytes one after another with their sizes.

    Parameters
    ----------
    path, kind
        As of `read_messages`.
    folder
        An empty folder for copies.
    """
    import apsw
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from yaml import YAMLError

    topics: Topics = {}
    messages: dict[str, list[bytes]] = defaultdict(list)
    try:
        files, are_packed = _files(path, Path(folder))
        for topic, data in _messages(files, kind, Path(folder), topics):
            messages[topic].append(_unpacked(data) if are_packed else data)
        form = "rosbag" if _suffix(files[0]) == ".bag" else "ros2bag"
    except (Error1, Error2, apsw.Error, YAMLError, *_DAMAGE) as error:
        raise _damaged(path, error, folder) from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    topic = _only_topic(path, kind, topics)
    parts = messages[topic]
    columns: Columns = {
        "data": np.frombuffer(b"".join(parts), np.uint8),
        "sizes": np.array([len(part) for part in parts], np.int64),
    }
    return Parsed(columns, {"topic": topic, "format": form})


def _damaged(path: Path, error: Exception, folder: str = "") -> InputError:
    text = str(error).replace(folder, "") if folder else str(error)
    fault = " ".join(text.split())[:_LONGEST_FAULT]
    return InputError(f"{path}: not a readable ROS bag ({type(error).__name__}: {fault})")


def _only_topic(path: Path, kind: str, topics: Topics) -> str:
    chosen = [topic for topic, type_ in topics.items() if type_ == kind]
    if len(chosen) == 1:
        return chosen[0]
    if chosen:
        has, remedy = f"it has {_listed(chosen)}", "keep one of them in a bag of its own"
    else:
        others = _listed([f"{topic} ({type_})" for topic, type_ in topics.items()])
        has, remedy = f"it has {others}", "record the driver's packets, or export its clouds (PCD)"
    raise InputError(f"{path}: the ROS bag must have one topic of {kind}; {has}: {remedy}")


def _listed(names: list[str]) -> str:
    """Names in a line, however many and long they are."""
    shown = [
        "".join(mark if mark.isprintable() else "?" for mark in name)[:_LONGEST_NAME]
        for name in sorted(names)[:_LISTED]
    ]
    others = [f"{len(names) - _LISTED} others"] if len(names) > _LISTED else []
    return ", ".join([*shown, *others]) or "no topic"


def _messages(files: list[Path], kind: str, folder: Path, topics: Topics) -> StoredMessages:
    """Topic and bytes of each message of a type; notes the types of all topics."""
    for file in files:
        with _storage(file, folder, kind) as (types, messages):
            topics |= types
            yield from messages


@contextmanager
def _storage(file: Path, folder: Path, kind: str) -> Iterator[tuple[Topics, StoredMessages]]:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    suffix = _suffix(file)
    if suffix == ".db3":
        with sqlite_storage(file, folder, kind) as found:
            yield found
        return
    link = folder / f"{len(list(folder.iterdir()))}{suffix}"  # the library goes by the suffix
    link.symlink_to(file.resolve())
    reader: Any = Reader1(link) if suffix == ".bag" else Reader2(link)
    with reader:
        _check_chunks(reader)
        chosen = [each for each in reader.connections if each.msgtype == kind]
        messages = reader.messages(connections=chosen) if chosen else ()
        types = {each.topic: each.msgtype for each in reader.connections}
        yield types, ((each.topic, data) for each, _, data in messages)


def _check_chunks(reader: Any) -> None:
    """Refuse an index that has some bytes of the file in several chunks."""
    if hasattr(reader, "chunks"):
        places = [(start, part.datapos + part.datasize) for start, part in reader.chunks.items()]
        listed = len(reader.chunk_infos)
    else:
        chunks = reader.storage.chunks
        places = [
            (part.chunk_start_offset, part.chunk_start_offset + part.chunk_length)
            for part in chunks
        ]
        listed = len(chunks)
    places = sorted(set(places))
    if len(places) < listed or any(first[1] > second[0] for first, second in pairwise(places)):
        raise ValueError("chunks overlap")


def _suffix(file: Path) -> str:
    with file.open("rb") as stream:
        suffix = bag_format(stream.read(16))
    if suffix is None:
        raise InputError(f"{file.name} is not a ROS bag")
    return suffix


def _files(path: Path, folder: Path) -> tuple[list[Path], bool]:
    """The files of a bag in their order, and whether each message is compressed by itself."""
    if not path.is_dir():
        return [path], False
    if not (path / _METADATA).is_file():
        return [_bag_in(path)], False
    metadata = _metadata(path / _METADATA)
    files = [path / Path(name).name for name in metadata["relative_file_paths"]]
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise InputError(f"{_METADATA} names files that are not there: {_listed(missing)}")
    mode = str(metadata.get("compression_mode") or "none").lower()
    if mode != "none" and metadata.get("compression_format") != "zstd":
        raise InputError(f"compression {metadata.get('compression_format')!r} is not read")
    if mode == "file":
        files = [_unpacked_file(file, folder) for file in files]
    return files, mode == "message"


def _metadata(path: Path) -> dict[str, Any]:
    import yaml

    metadata: dict[str, Any] = yaml.safe_load(path.read_bytes())["rosbag2_bagfile_information"]
    return metadata


def _bag_in(folder: Path) -> Path:
    """The only file of a bag in a folder."""
    bags = sorted(path for path in folder.iterdir() if path.suffix in _STARTS.values())
    if len(bags) != 1:
        raise InputError(f"{len(bags)} ROS bags (.bag, .db3, .mcap) and no {_METADATA}, not one")
    return bags[0]


def _unpacked_file(file: Path, folder: Path) -> Path:
    import pyarrow as pa

    place = folder / f"{len(list(folder.iterdir()))}{Path(file.stem).suffix}"
    with pa.input_stream(str(file), compression="zstd") as packed, place.open("wb") as out:
        shutil.copyfileobj(packed, out)
    return place


def _unpacked(data: bytes) -> bytes:
    import pyarrow as pa

    with pa.input_stream(pa.py_buffer(data), compression="zstd") as packed:
        return bytes(packed.read())


@cache
def _types(is_ros1: bool, definitions: tuple[tuple[str, str], ...]) -> Any:
    """The standard message types and the given ones, which are compiled."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name, text in definitions:
        types.register(get_types_from_msg(text, name))
    return types
