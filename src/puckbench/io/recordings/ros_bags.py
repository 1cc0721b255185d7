"""Reader of messages in ROS bags (ROS 1 .bag, ROS 2 .db3, .mcap and folders), without ROS."""

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

from puckbench.core.errors import InputError, naming
from puckbench.io.damage import reading
from puckbench.io.isolated import ParsedFile, parse_isolated
from puckbench.io.point_columns import Columns
from puckbench.io.recordings.sqlite_bags import (
    SIDE_FILE_SUFFIXES,
    StoredMessages,
    Topics,
    sqlite_storage,
)

_MAGICS = {b"SQLite format 3\x00": ".db3", b"\x89MCAP0\r\n": ".mcap", b"#ROSBAG": ".bag"}
"""Suffix of each kind of bag by its first bytes."""
_METADATA = "metadata.yaml"
_MAX_LISTED, _MAX_NAME_LENGTH = 8, 60
_DAMAGE = (
    *(struct.error, OSError, EOFError, RuntimeError, ArithmeticError, AssertionError),
    *(AttributeError, LookupError, TypeError, ValueError),
)
"""Exceptions of the libraries for damaged bags besides their own."""


@dataclass(frozen=True)
class Messages:
    topic: str
    messages: list[Any]
    format: str


def bag_format(start: bytes) -> str | None:
    """Return the file suffix of ROS bags that begin with the bytes `start`, or None."""
    return next((suffix for magic, suffix in _MAGICS.items() if start.startswith(magic)), None)


def read_messages(path: Path, kind: str, definitions: Mapping[str, str]) -> Messages:
    """Read the messages of the only topic whose type is `kind` ("velodyne_msgs/msg/VelodyneScan").

    `definitions` define the type and its parts; definitions in the bag are not used, because they
    would be compiled. Raises InputError if the file is damaged, or has no or several topics of the
    type.
    """
    from rosbags.serde import SerdeError

    side_files = [path.with_name(path.name + suffix) for suffix in SIDE_FILE_SUFFIXES]
    with TemporaryDirectory() as folder:
        options = {"kind": kind, "folder": folder}
        parsed = parse_isolated(parse_bag, path, "ROS bag", options, side_files)
    topic, form = parsed.about["topic"], parsed.about["format"]
    is_ros1 = form == "rosbag"
    types = _types(is_ros1, tuple(definitions.items()))
    decode = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
    data, ends = parsed.columns["data"], accumulate(parsed.columns["sizes"].tolist(), initial=0)
    with naming(path), reading("ROS bag", SerdeError, *_DAMAGE):
        messages = [decode(data[start:end].tobytes(), kind) for start, end in pairwise(ends)]
    return Messages(topic, messages, form)


def parse_bag(path: Path, kind: str, folder: str) -> ParsedFile:
    """Read the messages of the only topic whose type is `kind`, with a folder for temporary files.

    The columns are ``data``, the joined bytes of all messages, and their ``sizes``.
    """
    import apsw
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from yaml import YAMLError

    topics: Topics = {}
    messages: dict[str, list[bytes]] = defaultdict(list)
    try:
        with naming(path), reading("ROS bag", Error1, Error2, apsw.Error, YAMLError, *_DAMAGE):
            files, are_compressed = _files(path, Path(folder))
            for topic, data in _messages(files, kind, Path(folder), topics):
                messages[topic].append(_decompressed(data) if are_compressed else data)
            form = "rosbag" if _suffix(files[0]) == ".bag" else "ros2bag"
    except InputError as error:
        raise InputError(str(error).replace(folder, "")) from error
    topic = _only_topic(path, kind, topics)
    parts = messages[topic]
    columns: Columns = {
        "data": np.frombuffer(b"".join(parts), np.uint8),
        "sizes": np.array([len(part) for part in parts], np.int64),
    }
    return ParsedFile(columns, {"topic": topic, "format": form})


def _only_topic(path: Path, kind: str, topics: Topics) -> str:
    matching = [topic for topic, type_ in topics.items() if type_ == kind]
    if len(matching) == 1:
        return matching[0]
    if matching:
        fault, advice = _listed(matching), "keep one of them in a bag of its own"
    else:
        fault = _listed([f"{topic} ({type_})" for topic, type_ in topics.items()])
        advice = "record the driver's packets, or export its clouds (PCD)"
    fault = f"the ROS bag must have one topic of {kind}; it has {fault}"
    raise InputError(f"{path}: {fault}: {advice}")


def _listed(names: list[str]) -> str:
    shortened = [
        "".join(letter if letter.isprintable() else "?" for letter in name)[:_MAX_NAME_LENGTH]
        for name in sorted(names)[:_MAX_LISTED]
    ]
    others = [f"{len(names) - _MAX_LISTED} others"] if len(names) > _MAX_LISTED else []
    return ", ".join([*shortened, *others]) or "no topic"


def _messages(files: list[Path], kind: str, folder: Path, topics: Topics) -> StoredMessages:
    """Yield topic and bytes of the messages whose type is `kind`; add all topics to `topics`."""
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
        with sqlite_storage(file, folder, kind) as storage:
            yield storage
        return
    link = folder / f"{len(list(folder.iterdir()))}{suffix}"  # the library requires the suffix
    link.symlink_to(file.resolve())
    reader: Any = Reader1(link) if suffix == ".bag" else Reader2(link)
    with reader:
        _check_chunks(reader)
        connections = [each for each in reader.connections if each.msgtype == kind]
        messages = reader.messages(connections=connections) if connections else ()
        types = {each.topic: each.msgtype for each in reader.connections}
        yield types, ((each.topic, data) for each, _, data in messages)


def _check_chunks(reader: Any) -> None:
    """Raise ValueError if chunks of a bag overlap, because these would be read repeatedly."""
    if hasattr(reader, "chunks"):
        ranges = [(start, chunk.datapos + chunk.datasize) for start, chunk in reader.chunks.items()]
        count = len(reader.chunk_infos)
    else:
        chunks = reader.storage.chunks
        starts = [chunk.chunk_start_offset for chunk in chunks]
        ranges = [(at, at + chunk.chunk_length) for at, chunk in zip(starts, chunks, strict=True)]
        count = len(chunks)
    ranges = sorted(set(ranges))
    if len(ranges) < count or any(first[1] > second[0] for first, second in pairwise(ranges)):
        raise ValueError("chunks overlap")


def _suffix(file: Path) -> str:
    with file.open("rb") as stream:
        suffix = bag_format(stream.read(16))
    if suffix is None:
        raise InputError(f"{file.name} is not a ROS bag")
    return suffix


def _files(path: Path, folder: Path) -> tuple[list[Path], bool]:
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
        files = [_decompressed_file(file, folder) for file in files]
    return files, mode == "message"


def _metadata(path: Path) -> dict[str, Any]:
    import yaml

    metadata: dict[str, Any] = yaml.safe_load(path.read_bytes())["rosbag2_bagfile_information"]
    return metadata


def _bag_in(folder: Path) -> Path:
    bags = sorted(path for path in folder.iterdir() if path.suffix in _MAGICS.values())
    if len(bags) != 1:
        raise InputError(f"{len(bags)} ROS bags (.bag, .db3, .mcap) and no {_METADATA}, not one")
    return bags[0]


def _decompressed_file(file: Path, folder: Path) -> Path:
    import pyarrow as pa

    copy = folder / f"{len(list(folder.iterdir()))}{Path(file.stem).suffix}"
    with pa.input_stream(str(file), compression="zstd") as stream, copy.open("wb") as out:
        shutil.copyfileobj(stream, out)
    return copy


def _decompressed(data: bytes) -> bytes:
    import pyarrow as pa

    with pa.input_stream(pa.py_buffer(data), compression="zstd") as stream:
        return bytes(stream.read())


@cache
def _types(is_ros1: bool, definitions: tuple[tuple[str, str], ...]) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name, text in definitions:
        types.register(get_types_from_msg(text, name))
    return types
