"""Input files count by their content, which is read once."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from puckbench.planning.file_digests import file_digests
from puckbench.planning.memory import Memory

LATER, EARLIER = (2e9, 2e9), (1e9, 1e9)


@pytest.fixture
def memory(tmp_path: Path) -> Path:
    return tmp_path / "results" / ".digests.json"


def digest(path: Path, memory: Path) -> str:
    """The digest in a run, whose memory is the file `memory`."""
    of_run = Memory(memory.parent)
    found = file_digests([path], of_run)[path]
    of_run.save()
    return found


def test_other_content_counts_whatever_its_time(tmp_path: Path, memory: Path) -> None:
    cloud = tmp_path / "a.xyz"
    cloud.write_text("0 0 0\n")
    os.utime(cloud, LATER)
    before = digest(cloud, memory)
    for height, times in ((1, EARLIER), (2, LATER)):  # as `unzip` does, and with the same time
        other = tmp_path / "other.xyz"
        other.write_text(f"0 0 {height}\n")
        os.utime(other, times)
        other.replace(cloud)
        assert digest(cloud, memory) != before
        before = digest(cloud, memory)


def test_a_file_edited_in_place_with_its_time_put_back_counts(tmp_path: Path, memory: Path) -> None:
    cloud = tmp_path / "a.xyz"
    cloud.write_text("0 0 0\n")
    os.utime(cloud, LATER)
    before = digest(cloud, memory)
    cloud.write_text("0 0 1\n")
    os.utime(cloud, LATER)
    assert digest(cloud, memory) != before


def test_equal_content_is_equal_with_any_time_and_place(tmp_path: Path, memory: Path) -> None:
    first, second = tmp_path / "a.xyz", tmp_path / "b.xyz"
    for path, times in ((first, EARLIER), (second, LATER)):
        path.write_text("0 0 0\n")
        os.utime(path, times)
    before = digest(first, memory)
    os.utime(first, LATER)
    assert digest(first, memory) == before == digest(second, memory)


def test_a_folder_counts_with_every_file_and_name(tmp_path: Path, memory: Path) -> None:
    bag = tmp_path / "bag"
    (bag / "inner").mkdir(parents=True)
    (bag / "inner" / "a.db3").write_text("a")
    (bag / "metadata.yaml").write_text("b")
    digests = [digest(bag, memory)]
    (bag / "inner" / "a.db3").write_text("c")
    digests.append(digest(bag, memory))
    (bag / "metadata.yaml").rename(bag / "other.yaml")
    digests.append(digest(bag, memory))
    (bag / "more").touch()
    digests.append(digest(bag, memory))
    assert len(set(digests)) == 4


def test_a_file_is_read_once(tmp_path: Path, memory: Path) -> None:
    cloud = tmp_path / "a.xyz"
    cloud.write_text("0 0 0\n")
    before = digest(cloud, memory)
    entries = json.loads(memory.read_text())
    entries[str(cloud)]["digest"] = "remembered"
    memory.write_text(json.dumps(entries))
    remembered = digest(cloud, memory)
    assert remembered != before
    os.utime(cloud, LATER)
    assert digest(cloud, memory) == before


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"a.xyz": {"state": "new"}}'])
def test_a_damaged_memory_is_made_anew(tmp_path: Path, memory: Path, damage: str) -> None:
    cloud = tmp_path / "a.xyz"
    cloud.write_text("0 0 0\n")
    before = digest(cloud, memory)
    memory.write_text(damage)
    assert digest(cloud, memory) == before
    assert str(cloud) in json.loads(memory.read_text())


def test_of_a_huge_file_size_time_and_parts_count(tmp_path: Path, memory: Path) -> None:
    huge = tmp_path / "drive.bag"
    with huge.open("wb") as stream:
        stream.truncate((1 << 30) + 1)
    os.utime(huge, LATER)
    digests = [digest(huge, memory)]
    with huge.open("r+b") as stream:  # the last byte, with the time put back
        stream.seek(1 << 30)
        stream.write(b"1")
    os.utime(huge, LATER)
    digests.append(digest(huge, memory))
    os.utime(huge, EARLIER)
    digests.append(digest(huge, memory))
    assert len(set(digests)) == 3


def test_what_is_no_file_is_not_opened(tmp_path: Path, memory: Path) -> None:
    pipe, lost = tmp_path / "pipe.ply", tmp_path / "lost.ply"
    os.mkfifo(pipe)
    lost.symlink_to(tmp_path / "nowhere.ply")
    assert digest(pipe, memory) == digest(lost, memory)
    (tmp_path / "nowhere.ply").write_text("here")
    assert digest(lost, memory) != digest(pipe, memory)


def test_planning_alone_writes_nothing(tmp_path: Path, memory: Path) -> None:
    cloud = tmp_path / "a.xyz"
    cloud.write_text("0 0 0\n")
    of_run = Memory(memory.parent)
    assert file_digests([cloud], of_run) == file_digests([cloud], of_run)
    assert not memory.parent.exists()
