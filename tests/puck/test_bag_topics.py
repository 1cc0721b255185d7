"""Topics of bags, and messages of a topic by their numbers."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puck.recordings import indexed_bags
from puck.recordings.point_cloud2 import POINT_CLOUD2
from puck.recordings.ros_bags import read_messages, read_topics
from puck.recordings.topics import Topic, choose_topic
from tests.support.cloud_bags import FORMATS, cloud_bag

TEXT = "std_msgs/msg/String"
KIND = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


def clouds(count: int, points: int = 3) -> list[np.ndarray]:
    return [np.full(points, number, KIND) for number in range(count)]


def numbers_of(path: Path, topic: str, numbers: Sequence[int] | None) -> list[int]:
    bag = read_messages(path, [POINT_CLOUD2], topic=topic, numbers=numbers)
    return [int(message.data.view("<f4")[0]) for message in bag.messages]


@pytest.mark.parametrize("form", FORMATS)
def test_topics_have_their_type_and_number_of_messages(tmp_path: Path, form: str) -> None:
    topics = {"/left": clouds(4), "/right": clouds(2)}
    path = cloud_bag(tmp_path / f"a.{form}", topics, others={"/chatter": "hello"})
    assert read_topics(path) == {
        "/left": Topic(POINT_CLOUD2, 4),
        "/right": Topic(POINT_CLOUD2, 2),
        "/chatter": Topic(TEXT, 1),
    }
    assert numbers_of(path, "/left", None) == [0, 1, 2, 3]
    assert numbers_of(path, "/left", [0, 3]) == [0, 3]
    assert numbers_of(path, "/right", range(1, 2)) == [1]
    assert numbers_of(path, "/right", []) == []
    with pytest.raises(InputError, match=r"topic /right has no message 2; it has 2, numbered"):
        numbers_of(path, "/right", [1, 2])
    with pytest.raises(InputError, match=r"several topics of sensor_msgs/msg/PointCloud2: /left, "):
        read_messages(path, [POINT_CLOUD2])
    with pytest.raises(InputError, match=r"has no topic /up; it has /chatter, /left, /right"):
        read_messages(path, [POINT_CLOUD2], topic="/up")
    with pytest.raises(InputError, match=r"topic /chatter is of std_msgs/msg/String, not of sens"):
        read_messages(path, [POINT_CLOUD2], topic="/chatter")


def test_messages_are_numbered_across_the_files_of_a_bag(tmp_path: Path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    names = ["a.mcap", "b.mcap", "c.mcap"]
    cloud_bag(folder / names[0], {"/points": clouds(2), "/others": clouds(1)})
    cloud_bag(folder / names[1], {"/others": clouds(1)})
    cloud_bag(folder / names[2], {"/points": clouds(5)[2:]})
    for making in folder.glob("*.making"):
        shutil.rmtree(making)
    listed = "".join(f"  - {name}\n" for name in names)
    text = f"rosbag2_bagfile_information:\n  relative_file_paths:\n{listed}"
    (folder / "metadata.yaml").write_text(text)
    assert read_topics(folder)["/points"] == Topic(POINT_CLOUD2, 5)
    assert numbers_of(folder, "/points", None) == [0, 1, 2, 3, 4]
    assert numbers_of(folder, "/points", [1, 2, 4]) == [1, 2, 4]
    assert numbers_of(folder, "/points", [3]) == [3]


@pytest.mark.parametrize("form", ["bag", "mcap"])
@pytest.mark.parametrize("step", [0, 1, 100])
def test_numbered_messages_are_those_of_the_whole_bag(tmp_path: Path, form: str, step: int) -> None:
    """Chunks of a few messages, of two topics, that overlap in time, and times that repeat."""
    path = tmp_path / f"a.{form}"
    times = [step * (number // 3) for number in range(40)]
    if step == 1:
        times = np.random.default_rng(1).permutation(times).tolist()
    write_texts(path, times)
    with indexed_bags.indexed_bag(path) as bag:
        assert bag.topics["/b"].messages == 40
        whole = list(bag.read("/b", None))
        for numbers in ([0], [39], [5, 6, 30], list(range(40)), [17, 18, 19], [38, 39]):
            assert list(bag.read("/b", numbers)) == [whole[number] for number in numbers]
        assert list(bag.read("/none", [0])) == []


def write_texts(path: Path, times: list[int], compress: bool = False) -> None:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    is_ros1 = path.suffix == ".bag"
    folder = path.with_suffix(".making")
    writer = (
        Writer1(path) if is_ros1 else Writer2(folder, version=8, storage_plugin=StoragePlugin.MCAP)
    )
    if compress and is_ros1:
        writer.set_compression(Writer1.CompressionFormat.BZ2)
    elif compress:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = [writer.add_connection(name, TEXT, typestore=types) for name in ("/a", "/b")]
        for number, time in enumerate(times):
            for connection in connections:
                text = f"{connection.topic} {number}".encode().ljust(200_000, b".")
                writer.write(connection, 10 + time, text)
    if not is_ros1:
        (file,) = folder.glob("*.mcap")
        file.rename(path)


def test_a_message_in_the_middle_is_read_without_the_chunks_before_it(tmp_path: Path) -> None:
    """Chunks before the message's own are damaged, which reading them would notice."""
    for form, at in (("bag", 4200), ("mcap", 120)):
        path = tmp_path / f"a.{form}"
        write_texts(path, [10 * number for number in range(40)], compress=True)
        data = bytearray(path.read_bytes())
        data[at : at + 40] = bytes(40)
        path.write_bytes(data)
        with indexed_bags.indexed_bag(path) as bag:
            (message,) = bag.read("/b", [35])
            assert message.startswith(b"/b 35.")
            with pytest.raises(Exception, match=r".+"):
                list(bag.read("/b", [0]))


def test_the_first_type_that_occurs_is_chosen() -> None:
    topics = {"/a": Topic("A", 1), "/b": Topic("B", 1), "/c": Topic("B", 1)}
    assert choose_topic(topics, ["A", "B"]) == "/a"
    assert choose_topic(topics, ["C", "A"]) == "/a"
    assert choose_topic(topics, ["A", "B"], "/c") == "/c"
    with pytest.raises(InputError, match="several topics of B: /b, /c: choose one by --topic"):
        choose_topic(topics, ["B", "A"])
    with pytest.raises(InputError, match=r"must have one topic of C or D; it has /a \(A\), "):
        choose_topic(topics, ["C", "D"])
