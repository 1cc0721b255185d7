"""Clouds of ROS bags as a data set, and prepared one at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from puckbench.cli import main
from puckbench.scene_sets.recordings import RecordingSet
from puckbench.scene_sets.registry import open_scene_set
from tests.support.cloud_bags import FORMATS, Rows, cloud_bag

KIND = np.dtype(
    {
        "names": ["intensity", "x", "y", "z", "ring", "rgb", "weights"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4", ("<f8", (2,))],
        "offsets": [0, 4, 8, 12, 16, 20, 24],
        "itemsize": 44,
    }
)


def cloud(number: int, points: int = 6) -> Rows:
    rows = np.zeros(points, KIND)
    for name in ("x", "y", "z"):
        rows[name] = np.random.default_rng([number, ord(name)]).uniform(-9, 9, points)
    rows["intensity"], rows["ring"] = number, np.arange(points)
    rows["rgb"] = np.full(points, 0x00102030, np.uint32).view("<f4")
    rows["weights"] = [number, -number]
    return rows


def bag_of(path: Path, count: int = 5, **topics: list[Rows]) -> Path:
    return cloud_bag(path, {"/points": [cloud(number) for number in range(count)], **topics})


def clouds_of(path: Path, **options: Any) -> RecordingSet:
    scenes = open_scene_set("recorded_clouds", {"path": str(path), **options})
    assert isinstance(scenes, RecordingSet)
    return scenes


@pytest.mark.parametrize("form", FORMATS)
def test_messages_are_clouds_in_metres_with_their_attributes(tmp_path: Path, form: str) -> None:
    scenes = clouds_of(bag_of(tmp_path / f"drive one.{form}"))
    assert scenes.names() == [f"drive_one_000{number}" for number in range(5)]
    scene = scenes.load("drive_one_0003")
    assert scene.cloud is not None
    expected = cloud(3)
    assert scene.cloud.xyz.tolist() == np.column_stack([expected[axis] for axis in "xyz"]).tolist()
    assert scene.cloud.colours is not None
    assert scene.cloud.colours.tolist() == [[0x10, 0x20, 0x30]] * 6
    fields = {name: values.tolist() for name, values in scene.cloud.fields.items()}
    assert fields == {
        "intensity": [3] * 6,
        "ring": [0, 1, 2, 3, 4, 5],
        "weights_0": [3] * 6,
        "weights_1": [-3] * 6,
    }
    source = {"source": f"drive one.{form}", "topic": "/points", "message": 3}
    assert scene.about == source
    assert scenes.files("drive_one_0003") == [tmp_path / f"drive one.{form}"]
    single = open_scene_set("recorded_clouds", scenes.options_of("drive_one_0003"))
    assert single.load("drive_one_0003").about == source


@pytest.mark.parametrize("form", FORMATS)
def test_compressed_clouds_are_those_that_were_compressed(tmp_path: Path, form: str) -> None:
    path = cloud_bag(tmp_path / f"a.{form}", {"/points": [cloud(0), cloud(1)]}, is_compressed=True)
    scene = clouds_of(path).load("a_0001")
    assert scene.cloud is not None
    assert scene.cloud.xyz[:, 0].tolist() == cloud(1)["x"].tolist()
    assert scene.cloud.fields["ring"].tolist() == cloud(1)["ring"].tolist()


def test_each_n_th_message_is_taken(tmp_path: Path) -> None:
    scenes = clouds_of(bag_of(tmp_path / "a.bag"), every=2)
    assert scenes.names() == ["a_0000", "a_0002", "a_0004"]
    with pytest.raises(InputError, match="no scene 'a_0003'"):
        scenes.load("a_0003")
    with pytest.raises(InputError, match="topic /points has no message 6; it has 5"):
        scenes.load("a_0006")


def test_points_without_coordinates_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = cloud(1)
    for axis in "xyz":
        rows[axis][[0, 4]] = np.nan
    path = cloud_bag(tmp_path / "a.mcap", {"/points": [rows]})
    about = {"missing_returns": 2, "dropped_points": 2}
    scene = clouds_of(path).load("a_0000")
    assert scene.cloud is not None
    assert scene.cloud.fields["ring"].tolist() == [1, 2, 3, 5]
    assert scene.about.items() >= about.items()
    rows["x"][1] = np.inf
    path = cloud_bag(tmp_path / "b.mcap", {"/points": [rows]})
    with pytest.raises(InputError, match=r"b.mcap: .*not finite.*--drop-invalid"):
        clouds_of(path).load("b_0000")
    scene = clouds_of(path, drop_invalid=True).load("b_0000")
    assert scene.about["dropped_points"] == 3
    assert scene.about["missing_returns"] == 2


def test_points_at_the_origin_of_an_image_are_missing_returns(tmp_path: Path) -> None:
    rows = cloud(1)
    for axis in "xyz":
        rows[axis][2] = 0
    for height, kept in ((1, [0, 1, 2, 3, 4, 5]), (2, [0, 1, 3, 4, 5])):
        name = f"a{height}"
        path = cloud_bag(tmp_path / f"{name}.db3", {"/points": [rows.reshape(height, -1)]})
        options = {"keep_missing": height == 1}
        scene = clouds_of(path, **options).load(f"{name}_0000")
        assert scene.cloud is not None
        assert scene.cloud.fields["ring"].tolist() == kept


@pytest.mark.parametrize("is_compressed", [False, True])
def test_messages_whose_byte_order_is_not_the_stated_one_are_read_right(
    is_compressed: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    clouds = [cloud(number, 50).astype(KIND.newbyteorder(">")) for number in range(2)]
    path = cloud_bag(tmp_path / "a.mcap", {"/points": clouds}, is_compressed=is_compressed)
    scenes = clouds_of(path)
    for number, name in enumerate(scenes.names()):
        read, expected = scenes.load(name).cloud, cloud(number, 50)
        assert read is not None
        assert np.array_equal(read.xyz, np.column_stack([expected[axis] for axis in "xyz"]))
        assert read.fields["ring"].tolist() == list(range(50))
    told = "topic /points: the order of bytes is not that of the field is_bigendian: exchanged"
    assert caplog.messages == [f"{path}: {told}"]


def test_a_topic_is_chosen_of_several(tmp_path: Path) -> None:
    path = bag_of(tmp_path / "a.bag", **{"/other": [cloud(7), cloud(8)]})
    scenes = clouds_of(path, topic="/other")
    assert scenes.names() == ["a_0000", "a_0001"]
    assert scenes.load("a_0001").about["topic"] == "/other"
    scenes = clouds_of(path)
    assert scenes.names() == scenes.unusable == ["a"]
    with pytest.raises(InputError, match=r"a.bag: .*: /other, /points: choose one by --topic"):
        scenes.load("a")


def test_unusable_bags_come_first_with_their_reason(tmp_path: Path) -> None:
    bag_of(tmp_path / "good.bag", 1)
    cloud_bag(tmp_path / "empty.mcap", {"/points": []}, others={"/chatter": "hello"})
    cloud_bag(tmp_path / "text.db3", {}, others={"/chatter": "hello"})
    (tmp_path / "torn.bag").write_bytes((tmp_path / "good.bag").read_bytes()[:5000])
    (tmp_path / "capture.pcap").write_bytes(b"not taken")
    for making in tmp_path.glob("*.making"):
        making.joinpath("metadata.yaml").unlink()
    scenes = clouds_of(tmp_path)
    assert scenes.names() == ["empty", "text", "torn", "good_0000"]
    reasons = {
        "empty": r"empty.mcap: topic /points has no message",
        "text": r"text.db3: .* must have one topic of .*PointCloud2; it has /chatter \(std_msgs",
        "torn": r"torn.bag: not a readable ROS bag",
    }
    for name, reason in reasons.items():
        with pytest.raises(InputError, match=reason):
            scenes.load(name)


def test_a_message_that_contradicts_itself_names_bag_topic_and_message(tmp_path: Path) -> None:
    path = bag_of(tmp_path / "a.db3", 2)
    data = path.read_bytes()
    field = b"ring\0\0\0\0\x10\0\0\0\x04"
    assert data.count(field) == 2
    path.write_bytes(data.replace(field, b"ring\0\0\0\0\x10\0\0\0\x09"))
    with pytest.raises(InputError, match=r"a.db3: topic /points: message 1: .*unknown type 9"):
        clouds_of(path).load("a_0001")


@pytest.mark.parametrize("form", FORMATS)
def test_prepare_writes_a_message_in_metres(
    tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = str(bag_of(tmp_path / f"a.{form}")), tmp_path / "a.ply"
    few = ["--neighbours", "3"]
    assert main(["prepare", path, str(out), "--turns", "2", *few]) == 0
    prepared = read_cloud(out)
    expected = np.column_stack([cloud(2)[axis] for axis in "xyz"]).astype(np.float64)
    assert prepared.xyz.tolist() == expected.tolist()
    assert prepared.about["size"] == 0
    assert prepared.about["message"] == 2
    assert prepared.fields["intensity"].tolist() == [2] * 6
    assert main(["prepare", path, str(out), *few]) == 0
    assert read_cloud(out).about["message"] == 0
    capsys.readouterr()
    faults = {
        ("--turns", "9"): "topic /points has no message 9; it has 5",
        ("--turns", "1-2"): "--turns: one cloud of a ROS bag is written, not 1-2",
        ("--topic", "/up"): "the ROS bag has no topic /up; it has /points",
        ("--stream", "1.2.3.4:5"): "only packet captures have streams",
    }
    for options, fault in faults.items():
        assert main(["prepare", path, str(out), *options]) == 2
        assert fault in capsys.readouterr().err
