"""Reader of ROS bags that have an index of their messages: ROS 1 (.bag) and MCAP."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

from puck.recordings.topics import BagFile, added_up


@contextmanager
def indexed_bag(path: Path) -> Iterator[BagFile]:
    """Open a bag, and yield its topics and the function that reads messages.

    Raises ValueError if chunks overlap, which only happens in damaged bags.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    reader: Any = Reader1(path) if path.suffix == ".bag" else Reader2(path)
    with reader:
        _check_chunks(reader)
        connections = reader.connections
        topics = added_up((each.topic, each.msgtype, each.msgcount) for each in connections)
        yield BagFile(topics, lambda topic, numbers: _messages(reader, topic, numbers))


def _check_chunks(reader: Any) -> None:
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


def _messages(reader: Any, topic: str, numbers: Sequence[int] | None) -> Iterator[bytes]:
    connections = [each for each in reader.connections if each.topic == topic]
    if not connections:
        return
    if numbers is None:
        yield from (data for *_, data in reader.messages(connections=connections))
        return
    starts, counts = _starts(reader, {each.id for each in connections})
    messages: Iterator[Any] = iter(())
    position = -1
    for number in numbers:
        place = bisect_right(counts, number) - 1
        if position < counts[place]:
            messages = reader.messages(connections=connections, start=starts[place])
            position = counts[place]
        for *_, data in messages:
            position += 1
            if position > number:
                yield data
                break


def _starts(reader: Any, ids: set[int]) -> tuple[list[int | None], list[int]]:
    if hasattr(reader, "indexes"):
        times = sorted(entry.time for each in ids for entry in reader.indexes[each])
        instants = sorted(set(times))
        return [None, *instants], [0, *(bisect_left(times, instant) for instant in instants)]
    chunks = [
        (chunk.message_start_time, chunk.message_end_time, count)
        for chunk in reader.storage.chunks
        if (count := sum(chunk.channel_count.get(each, 0) for each in ids))
    ]
    chunks.sort()
    ends = accumulate((end for _, end, _ in chunks), max)
    before = accumulate(count for *_, count in chunks)
    places = [
        (start, count)
        for end, count, (start, *_) in zip(ends, before, chunks[1:], strict=False)
        if end < start
    ]
    return [None, *(start for start, _ in places)], [0, *(count for _, count in places)]
