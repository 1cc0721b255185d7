"""Bags in SQLite that are large, or changed while they are read (others: corpus/bags.py)."""

from __future__ import annotations

from pathlib import Path

from puck.recordings import sqlite_bags
from puck.recordings.packets import SCAN
from puck.recordings.topics import Topic
from tests.support.bag_files import TOPIC, bag_with_log, sqlite_bag


def messages_of(path: Path, folder: Path) -> list[bytes]:
    folder.mkdir()
    with sqlite_bags.sqlite_bag(path, folder) as bag:
        messages = list(bag.read(TOPIC, None))
        assert bag.topics == {TOPIC: Topic(SCAN, len(messages))}
        return messages


def test_honest_bags_need_fewer_steps_than_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    sqlite_bag(path, [b"x"] * 200_000)
    assert messages_of(path, tmp_path / "copies") == [b"x"] * 200_000


def test_a_bag_with_a_log_is_not_changed(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    bag_with_log(path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert len(messages_of(path, tmp_path / "copies")) == 1
    after = {file.name: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}
    assert after == before
