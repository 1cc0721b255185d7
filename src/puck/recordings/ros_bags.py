"""Reader of messages in ROS bags (ROS 1 .bag, ROS 2 .db3, .mcap and folders), without ROS."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pointkit.damage import PARSER_FAULTS, reading
from pointkit.errors import InputError, naming
from pointkit.files import open_file, unreadable
from pointkit.isolated import Columns, ParsedFile, parse_isolated
from puck.recordings.indexed_bags import indexed_bag
from puck.recordings.sqlite_bags import SIDE_FILE_SUFFIXES, sqlite_bag
from puck.recordings.topics import BagFile, Topic, Topics, added_up, choose_topic, listed

_MAGICS = {b"SQLite format 3\x00": ".db3", b"\x89MCAP0\r\n": ".mcap", b"#ROSBAG": ".bag"}
"""File suffix of each bag format, by the first bytes of a file."""
_METADATA = "metadata.yaml"
_MAX_MAGIC_LENGTH = 16


@dataclass(frozen=True)
class Messages:
    """Deserialised messages of one topic of a ROS bag.

    `format` is "rosbag" (ROS 1) or "ros2bag", `kind` is the type of the messages.
    """

    topic: str
    kind: str
    messages: list[Any]
    format: str


def bag_format(start: bytes) -> str | None:
    """Return the suffix of ROS bags that begin with the bytes `start`; None for other files."""
    return next((suffix for magic, suffix in _MAGICS.items() if start.startswith(magic)), None)


def is_bag(path: Path) -> bool:
    """Return whether a path is a folder or a file with the first bytes of a ROS bag."""
    if path.is_dir():
        return True
    try:
        with open_file(path) as stream:
            return bag_format(stream.read(_MAX_MAGIC_LENGTH)) is not None
    except OSError as error:
        raise unreadable(path, error) from error


def read_topics(path: Path) -> Topics:
    """Return the topics of a bag by name, with their types and numbers of messages.

    Raises InputError if the file is damaged or is no bag.
    """
    topics = _isolated(parse_topics, path).about["topics"]
    return {name: Topic(*topic) for name, topic in topics.items()}


def read_messages(
    path: Path,
    kinds: Sequence[str],
    definitions: Mapping[str, str] | None = None,
    topic: str | None = None,
    numbers: Sequence[int] | None = None,
) -> Messages:
    """Read and deserialise messages of one topic.

    Parameters
    ----------
    path
        File (.bag, .db3, .mcap), or folder of a ROS 2 bag.
    kinds
        Message types that the caller can use, the preferred one first.
    definitions
        Definitions, in ROS's notation, of message types that the package `rosbags` lacks.
        Definitions in the bag are not used, because `rosbags` would compile them.
    topic
        Name of the topic; by default, the only topic of the first type in `kinds` that occurs.
    numbers
        Numbers of messages to read, ascending from 0; by default, all.

    Returns
    -------
    Messages
        The topic's name and type, and the messages in the order of time.

    Raises
    ------
    InputError
        The file is damaged, it has no such topic or several, or it lacks a message of `numbers`.
    """
    from rosbags.serde import SerdeError

    selected = None if numbers is None else list(numbers)
    parsed = _isolated(parse_bag, path, kinds=list(kinds), topic=topic, numbers=selected)
    topic, kind, form = (parsed.about[key] for key in ("topic", "kind", "format"))
    types = _types(form == "rosbag", tuple((definitions or {}).items()))
    decode = types.deserialize_ros1 if form == "rosbag" else types.deserialize_cdr
    data, ends = parsed.columns["data"], accumulate(parsed.columns["sizes"].tolist(), initial=0)
    with naming(path), reading("ROS bag", SerdeError, *PARSER_FAULTS):
        messages = [decode(data[start:end].tobytes(), kind) for start, end in pairwise(ends)]
    return Messages(topic, kind, messages, form)


def _isolated(parse: Callable[..., ParsedFile], path: Path, **options: Any) -> ParsedFile:
    side_files = [path.parent / f"{path.name}{suffix}" for suffix in SIDE_FILE_SUFFIXES]
    with TemporaryDirectory() as folder:
        return parse_isolated(parse, path, "ROS bag", {**options, "folder": folder}, side_files)


def parse_topics(path: Path, folder: str) -> ParsedFile:
    """Read topics as `read_topics` does; this function runs in the worker process."""
    with _reading(path, folder):
        files, _ = _files(path, Path(folder))
        return ParsedFile({}, {"topics": _all_topics(_topics_of_files(files, Path(folder)))})


def parse_bag(
    path: Path, folder: str, kinds: Sequence[str], topic: str | None, numbers: Sequence[int] | None
) -> ParsedFile:
    """Read messages as `read_messages` does; this function runs in the worker process.

    The result has the columns ``data``, the joined bytes of all messages, and ``sizes``, the number
    of bytes of each message. The argument `folder` is for temporary files.
    """
    with _reading(path, folder):
        files, are_compressed = _files(path, Path(folder))
        by_file = _topics_of_files(files, Path(folder))
        topics = _all_topics(by_file)
        name = choose_topic(topics, kinds, topic)
        counts = [each[name].messages if name in each else 0 for each in by_file]
        parts = list(_messages(files, Path(folder), name, counts, numbers))
        if are_compressed:
            parts = list(map(_decompressed, parts))
        form = "rosbag" if _suffix(files[0]) == ".bag" else "ros2bag"
    if numbers is not None and len(parts) < len(numbers):
        lacking = f"{numbers[len(parts)]}; it has {sum(counts)}"
        raise InputError(f"{path}: topic {name} has no message {lacking}, numbered from 0")
    columns: Columns = {
        "data": np.frombuffer(b"".join(parts), np.uint8),
        "sizes": np.array([len(part) for part in parts], np.int64),
    }
    return ParsedFile(columns, {"topic": name, "kind": topics[name].kind, "format": form})


@contextmanager
def _reading(path: Path, folder: str) -> Iterator[None]:
    import apsw
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from yaml import YAMLError

    try:
        faults = (Error1, Error2, apsw.Error, YAMLError, *PARSER_FAULTS)
        with naming(path), reading("ROS bag", *faults):
            yield
    except InputError as error:
        raise InputError(str(error).replace(folder, "")) from error


def _topics_of_files(files: list[Path], folder: Path) -> list[Topics]:
    by_file = []
    for file in files:
        with _bag_file(file, folder) as bag:
            by_file.append(bag.topics)
    return by_file


def _all_topics(by_file: list[Topics]) -> Topics:
    return added_up((name, *topic) for each in by_file for name, topic in each.items())


def _messages(
    files: list[Path], folder: Path, topic: str, counts: list[int], numbers: Sequence[int] | None
) -> Iterator[bytes]:
    for file, (start, end) in zip(files, pairwise(accumulate(counts, initial=0)), strict=True):
        selected = None
        if numbers is not None:
            selected = [number - start for number in numbers if start <= number < end]
        if selected is None or selected:
            with _bag_file(file, folder) as bag:
                yield from bag.read(topic, selected)


def _bag_file(file: Path, folder: Path) -> AbstractContextManager[BagFile]:
    suffix = _suffix(file)
    if suffix == ".db3":
        return sqlite_bag(file, folder)
    link = folder / f"{len(list(folder.iterdir()))}{suffix}"  # the library requires the suffix
    link.symlink_to(file.resolve())
    return indexed_bag(link)


def _suffix(file: Path) -> str:
    with open_file(file) as stream:
        suffix = bag_format(stream.read(_MAX_MAGIC_LENGTH))
    if suffix is None:
        raise InputError(f"{file.name} is not a ROS bag")
    return suffix


def _files(path: Path, folder: Path) -> tuple[list[Path], bool]:
    import yaml

    if not path.is_dir():
        return [path], False
    if not (path / _METADATA).is_file():
        return [_bag_in(path)], False
    metadata = yaml.safe_load((path / _METADATA).read_bytes())["rosbag2_bagfile_information"]
    files = [path / Path(name).name for name in metadata["relative_file_paths"]]
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise InputError(f"{_METADATA} names files that are not there: {listed(missing)}")
    mode = str(metadata.get("compression_mode") or "none").lower()
    if mode != "none" and metadata.get("compression_format") != "zstd":
        raise InputError(f"compression {metadata.get('compression_format')!r} is not read")
    if mode == "file":
        files = [_decompressed_file(file, folder) for file in files]
    return files, mode == "message"


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
