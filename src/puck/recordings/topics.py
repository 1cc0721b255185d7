"""Topics of ROS bags, and selection of one of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import NamedTuple

from pointkit.errors import InputError

_MAX_LISTED, _MAX_NAME_LENGTH = 8, 60


class Topic(NamedTuple):
    """Type of a topic, such as "sensor_msgs/msg/PointCloud2", and number of its messages."""

    kind: str
    messages: int


Topics = dict[str, Topic]


def added_up(parts: Iterable[tuple[str, str, int]]) -> Topics:
    """Return topics by name, with the numbers of messages of equally named `parts` added up.

    Each of the `parts` has a name, a type and a number of messages.
    """
    topics: Topics = {}
    for name, kind, messages in parts:
        before = topics[name].messages if name in topics else 0
        topics[name] = Topic(kind, before + messages)
    return topics


class BagFile(NamedTuple):
    """One file of a bag: its topics, and a function that reads the messages of a topic.

    The function takes the topic's name and the sorted numbers of messages in time order, or None
    for all messages.
    """

    topics: Topics
    read: Callable[[str, Sequence[int] | None], Iterator[bytes]]


def refuse_topic(name: str | None) -> None:
    """Raise InputError if `name`, which selects a topic, is set for a file without topics.

    Only ROS bags have topics.
    """
    if name is not None:
        raise InputError(f"topic '{name}': only ROS bags have topics")


def choose_topic(topics: Topics, kinds: Sequence[str], name: str | None = None) -> str:
    """Return the name of the topic to read.

    This is `name` if it is given, otherwise the only topic of the first type in `kinds` that
    occurs. Raises InputError if no topic or several topics match.
    """
    if name is not None:
        if name not in topics:
            raise InputError(f"the ROS bag has no topic {name}; it has {listed(topics)}")
        if (kind := topics[name].kind) not in kinds:
            raise InputError(f"topic {name} is of {kind}, not of {' or '.join(kinds)}")
        return name
    for kind in kinds:
        matching = [topic for topic, (type_, _) in topics.items() if type_ == kind]
        if len(matching) == 1:
            return matching[0]
        if matching:
            choices = listed(matching)
            fault = f"the ROS bag has several topics of {kind}: {choices}"
            raise InputError(f"{fault}: choose one by --topic or the option topic")
    types = listed([f"{topic} ({type_})" for topic, (type_, _) in topics.items()])
    fault = f"the ROS bag must have one topic of {' or '.join(kinds)}; it has {types}"
    raise InputError(f"{fault}: record packets, or use its clouds (data set recorded_clouds)")


def listed(names: Collection[str]) -> str:
    """Return at most eight of the names, sorted, as text for an error message."""
    shortened = [
        "".join(letter if letter.isprintable() else "?" for letter in name)[:_MAX_NAME_LENGTH]
        for name in sorted(names)[:_MAX_LISTED]
    ]
    others = [f"{len(names) - _MAX_LISTED} others"] if len(names) > _MAX_LISTED else []
    return ", ".join([*shortened, *others]) or "no topic"
