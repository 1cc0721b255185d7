"""The configuration that `puckbench run` makes of a user's files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from cloud_files.poses import kitti_bytes, tum_bytes
from pointkit.errors import InputError
from pointkit.lidar.return_table import read_return_table
from puck import CodingOptions, compress
from puckbench.cli import main
from puckbench.planning.config import checked
from puckbench.planning.plan import Plan
from puckbench.planning.study_run import study_configuration
from puckbench.planning.user_files import UserRun, write_configuration
from puckbench.planning.workflow import Workflow
from puckbench.report.reference_results import read_reference
from puckbench.scene_sets.registry import open_scene_set
from tests.cloud_files.test_cloud_formats import write_las
from tests.support.bag_files import sqlite_bag
from tests.support.capture_bytes import ethernet, ipv4, udp
from tests.support.capture_bytes import pcap as pcap_of_frames
from tests.support.cloud_bags import cloud_bag
from tests.support.spinning import pcap, rows, spin

POINTS = np.random.default_rng(1).random((50, 3))
OWN = """
from puckbench.codecs.base import Codec, lengths


class MyCodec(Codec):
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        return b""

    def decode(self, stream):
        return None
"""


@pytest.fixture(autouse=True)
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working folder with a file of every kind."""
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    np.save("mine/a.npy", POINTS)
    np.savetxt("mine/b.xyz", POINTS)
    write_las(Path("utm.las"))
    trimesh.creation.box((5, 4, 3)).export("mine/box.ply")
    Path("drive.pcap").write_bytes(pcap([bytes(packet) for packet in spin(packets=600)]))
    Path("mine.py").write_text(OWN)


def made(*paths: str, codecs: tuple[str, ...] = ("draco",), **asked: Any) -> dict[str, Any]:
    return UserRun(paths, codecs, "out", **asked).configuration()


def test_a_folder_is_sorted_by_what_its_files_hold() -> None:
    config = made("mine", "drive.pcap")
    assert config["scene_sets"]["clouds"] == {"loader": "point_clouds", "options": {"path": "mine"}}
    assert config["scene_sets"]["meshes"]["loader"] == "mesh_files"
    assert config["scene_sets"]["recordings"]["options"]["path"] == "drive.pcap"
    sizes = {name: data["size"] for name, data in config["datasets"].items()}
    assert sizes == {"clouds": 1024, "meshes": 1024, "recordings": "metric"}
    assert config["datasets"]["meshes"]["make"] == "sample"
    examples = config["figures"]["examples"]
    assert examples["object"] == "clouds/a"
    assert examples["spin"].startswith("recordings/drive_")


def test_a_pipe_is_left_out() -> None:
    os.mkfifo("pipe.ply")
    os.mkfifo("mine/pipe.las")
    config = made("pipe.ply", "mine")
    assert config["unused"]["pipe.ply"] == "a pipe, not a file"
    assert config["scene_sets"].keys() == made("mine")["scene_sets"].keys()
    with pytest.raises(InputError, match=r"^pipe\.ply: a pipe, not a file$"):
        made("pipe.ply")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("{x}", "Snakemake takes '{x}' in its path for a wildcard"),
        ("a{ b.1 ,[0-9]+}c", "Snakemake takes '{ b.1 ,[0-9]+}' in its path for a wildcard"),
        ("<x>", "Snakemake takes '<x>' in its path for a wildcard"),
        ("a\nb", "its path has a line break, or is not in UTF-8"),
        ("bad\udcff", "its path has a line break, or is not in UTF-8"),
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".obj"])
def test_a_file_that_snakemake_cannot_name_is_left_out(name: str, why: str, suffix: str) -> None:
    path = Path("mine", f"{name}{suffix}")
    path.write_bytes(Path("mine/a.npy").read_bytes())
    if suffix == ".obj":
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    plan = Plan(checked(made("mine")), check_scenes=True)
    (row,) = [row for row in plan.left_out_rows() if row["scene"]]
    assert row["reason"] == f"rename it: {why}"
    assert row["file"] == str(path).replace("\n", r"\n").replace("\udcff", r"\udcff")
    assert [cloud for _, cloud in plan.clouds] == ["a", "b", "box"]


@pytest.mark.parametrize(
    "name",
    ["a'b", 'a"b', "a*b", "a?b", "a[b]", "$HOME", "a  b", "a%b", "a:b", "-a", "{}", "<A B>", "a{b"],
)
def test_other_letters_of_names_are_no_hindrance(name: str) -> None:
    np.save(f"{name}.npy", POINTS)
    plan = Plan(checked(made(f"{name}.npy")), check_scenes=True)
    assert not [row for row in plan.left_out_rows() if row["scene"]]


def test_meshes_are_scanned_where_that_is_asked_for() -> None:
    config = made("mine/box.ply", scan=True, errors="vlp16")
    assert config["datasets"]["scans"] | {"sweep": {}} == {
        "scene_set": "meshes", "make": "scan", "errors": "vlp16", "sweep": {}, "size": 1024
    }  # fmt: skip
    assert config["figures"]["examples"] == {"noisy": "scans/box"}


@pytest.mark.parametrize(
    ("paths", "frame", "size", "remark"),
    [
        (("utm.las",), None, "metric", ""),
        (("mine/a.npy",), None, 1024, "none in .npy: all clouds are scaled to [0, 1023]"),
        (("utm.las", "mine/a.npy"), None, 1024, "none in .npy, unlike .las: all clouds are scaled"),
        (("utm.las",), "scaled", 1024, ""),
        (("mine/a.npy",), "metric", "metric", ""),
    ],
)
def test_the_frame_follows_the_formats_and_scaling_is_told(
    paths: tuple[str, ...], frame: Any, size: object, remark: str
) -> None:
    config = made(*paths, frame=frame)
    assert config["datasets"]["clouds"]["size"] == size
    output = config.get("unused", {}).get("unit of clouds", "")
    assert output.startswith(remark)
    assert bool(output) == bool(remark)


def test_a_peak_is_that_of_clouds_in_metres() -> None:
    config = made("mine", "utm.las", "drive.pcap", frame="scaled", peak=59.7)
    peaks = {name: data.get("peak") for name, data in config["datasets"].items()}
    assert peaks == {"clouds": None, "meshes": None, "recordings": 59.7}
    flow = Workflow(config)
    steps = (
        flow.step("evaluate", dataset=dataset, cloud=cloud, codec=codec)
        for dataset, cloud, codec in flow.plan.curves
    )
    measured = {step.step.dataset: step.step.peak for step in steps}
    assert measured == {"clouds": None, "meshes": None, "recordings": 59.7}  # None: their own


def test_recordings_are_compared_in_codecs_of_sensors_where_none_are_named() -> None:
    of_sensors = ["gpcc", "gpcc_predictive", "puck"]
    assert list(made("drive.pcap", codecs=())["codecs"]) == of_sensors
    assert list(made("mine/a.npy", codecs=())["codecs"]) == ["draco", "gpcc"]
    assert list(made("mine/a.npy", "drive.pcap", codecs=())["codecs"]) == ["draco", *of_sensors]


@pytest.mark.parametrize("codecs", [(), ("gpcc_predictive", "gpcc", "puck")])
def test_a_codec_without_a_requested_rate_is_left_out_and_named(codecs: tuple[str, ...]) -> None:
    config = made("drive.pcap", codecs=codecs, rates=("100mm", "10mm"))
    assert list(config["codecs"]) == ["gpcc", "puck"]
    assert config["unused"]["codec gpcc_predictive"].startswith("none of the requested rates (it")


def test_a_codec_without_a_requested_rate_ends_a_strict_run_and_a_run_of_no_other() -> None:
    none = "codec gpcc_predictive has none of 100mm"
    with pytest.raises(InputError, match=none):
        made("drive.pcap", codecs=("puck", "gpcc_predictive"), rates=("100mm",), strict=True)
    with pytest.raises(InputError, match=none):
        made("drive.pcap", codecs=("gpcc_predictive",), rates=("100mm",))
    with pytest.raises(InputError, match="--frame scaled: recordings are coded in metres"):
        made("drive.pcap", codecs=("primitives",), frame="scaled")


def test_rates_that_no_codec_has_for_one_of_two_frames_are_refused() -> None:
    with pytest.raises(InputError, match=r"codec draco has none of 100mm"):
        made("mine/a.npy", "drive.pcap", codecs=("draco", "puck"), rates=("100mm",))
    config = made("mine/a.npy", "drive.pcap", codecs=("draco", "puck"), rates=("100mm", "r1"))
    assert config["codecs"]["draco"] == {"rates": ["r1"], "metric_rates": ["100mm"]}


def test_rates_may_be_any_lengths() -> None:
    config = made("drive.pcap", codecs=("puck", "gpcc"), rates=("0.5mm", "3mm", "2cm"))
    assert {tuple(entry["metric_rates"]) for entry in config["codecs"].values()} == {
        ("20mm", "3mm", "0.5mm")
    }
    assert list(made("drive.pcap", codecs=(), rates=("3mm",))["codecs"]) == ["gpcc", "puck"]
    with pytest.raises(InputError, match=r"codec gpcc_predictive has none of 3mm .*1mm"):
        made("drive.pcap", codecs=("gpcc_predictive",), rates=("3mm",))
    with pytest.raises(InputError, match=r"--rates: rate '0mm': a length must be from 0.001mm"):
        made("drive.pcap", rates=("0mm",))
    with pytest.raises(InputError, match=r"codec draco has none of 3mm .*: use --frame metric"):
        made("mine/a.npy", rates=("3mm",))


def test_a_compressed_copy_of_a_recording_is_left_out_and_named() -> None:
    Path("drives").mkdir()
    Path("drive.pcap").rename("drives/a.pcap")
    Path("drives/a.puck").touch()
    output = made("drives")["unused"]
    assert output["drives/a.puck"] == "taken for a copy of the recording of its name"


def test_a_recording_that_cannot_be_used_is_left_out_and_named() -> None:
    Path("torn.pcap").write_bytes(b"no capture at all")
    config = made("*.pcap")
    assert config["scene_sets"]["recordings"]["options"]["path"] == "*.pcap"
    plan = Plan(checked(config), check_scenes=True)
    assert list(plan.left_out["recordings"]) == ["torn"]
    assert "torn.pcap: not a packet capture" in plan.left_out["recordings"]["torn"]
    assert all(cloud.startswith("drive_") for cloud in plan.datasets["recordings"].clouds)
    points = plan.datasets["recordings"].points
    assert 5000 < points < 10_000  # of a turn of 225 blocks of 32 firings, four of five returned
    with pytest.raises(InputError, match=r"scene torn: torn\.pcap"):
        made("*.pcap", strict=True)


def test_recordings_of_which_none_can_be_used_do_not_end_a_run() -> None:
    Path("torn.pcap").write_bytes(b"no capture at all")
    Path("short.pcap").write_bytes(pcap(rows(spin(packets=4))))
    plan = Plan(checked(made("mine/a.npy", "torn.pcap", "short.pcap")), check_scenes=True)
    assert {dataset for dataset, _ in plan.clouds} == {"clouds"}
    assert set(plan.left_out["recordings"]) == {"torn", "short"}
    assert "torn.pcap: not a packet capture" in plan.left_out["recordings"]["torn"]
    for paths, strict in ((("torn.pcap",), False), (("mine/a.npy", "torn.pcap"), True)):
        with pytest.raises(InputError, match=r"torn\.pcap: not a packet capture"):
            made(*paths, strict=strict)


def test_folders_of_bag_folders_are_recordings() -> None:
    Path("bags/one").mkdir(parents=True)
    Path("bags/one/metadata.yaml").touch()
    Path("bags/one/one.db3").write_bytes(b"SQLite format 3\0" + bytes(600))
    Path("bags/drive.pcap").write_bytes(Path("drive.pcap").read_bytes())
    for paths in (("bags",), ("bags/*",)):
        plan = Plan(checked(made(*paths)), check_scenes=True)
        assert list(plan.left_out["recordings"]) == ["one"]
        assert "bags/one: not a readable ROS bag" in plan.left_out["recordings"]["one"]


def cloud(number: int) -> np.ndarray:
    rows = np.zeros(50, [(axis, "<f4") for axis in "xyz"])
    for axis in "xyz":
        rows[axis] = np.random.default_rng([number, ord(axis)]).random(50)
    return rows


def test_clouds_of_bags_are_planned_in_metres_ten_of_them() -> None:
    cloud_bag(Path("drive.bag"), {"/points": [cloud(number) for number in range(25)]})
    config = made("drive.bag")
    scenes = config["scene_sets"]["recorded_clouds"]
    assert scenes["loader"] == "recorded_clouds"
    assert scenes["options"] == {"path": "drive.bag"}
    assert len(scenes["select"]) == 10
    assert scenes["select"][0] == "drive_0000"
    assert scenes["select"][-1] == "drive_0024"
    assert config["datasets"]["recorded_clouds"]["size"] == "metric"
    assert config["unused"]["recorded_clouds"] == "10 of 25 clouds are coded (--limit)"
    assert made("drive.bag", frame="scaled")["datasets"]["recorded_clouds"]["size"] == 1024
    few = made("drive.bag", limit=2)["scene_sets"]["recorded_clouds"]["select"]
    assert few == ["drive_0000", "drive_0024"]


@pytest.mark.parametrize("form", ["bag", "db3", "mcap"])
def test_a_compressed_bag_of_clouds_is_run_as_the_bag(form: str) -> None:
    """Whether its clouds are coded as such, or by LZMA since there are few of them."""
    for count in (3, 25):
        path = Path(f"drive{count}.{form}")
        bag = cloud_bag(path, {"/points": [cloud(number) for number in range(count)]})
        compress(bag, Path("small.puck"), CodingOptions(effort="fast"))
        plain, packed = made(str(bag), limit=4), made("small.puck", limit=4)
        scenes = packed["scene_sets"]["recorded_clouds"]
        assert scenes["loader"] == "recorded_clouds"
        assert packed["datasets"] == plain["datasets"]
        assert packed["codecs"] == plain["codecs"]
        loaded = open_scene_set("recorded_clouds", scenes["options"])
        others = open_scene_set("recorded_clouds", {"path": str(bag)})
        assert len(loaded.names()) == count
        for name, other in zip(loaded.names(), others.names(), strict=True):
            assert np.array_equal(loaded.load(name).cloud.xyz, others.load(other).cloud.xyz)
            assert loaded.load(name).about["source"] == "small.puck"


def test_copies_of_compressed_bags_are_deleted(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud_bag(Path("drive.mcap"), {"/points": [cloud(0)]})
    compress(Path("drive.mcap"), Path("drive.puck"))
    Path("temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(Path("temporary").absolute()))
    scenes = open_scene_set("recorded_clouds", {"path": {"drive": "drive.puck"}})
    scenes.load("drive_0000")
    assert len(list(Path("temporary").iterdir())) == 1
    del scenes
    assert not list(Path("temporary").iterdir())


def test_a_damaged_compressed_bag_is_left_out_in_one_line() -> None:
    cloud_bag(Path("drive.mcap"), {"/points": [cloud(0)]})
    compress(Path("drive.mcap"), Path("a.puck"))
    Path("a.puck").write_bytes(Path("a.puck").read_bytes()[:-9])
    plan = Plan(checked(made("a.puck", "drive.pcap")), check_scenes=True)
    (faults,) = plan.left_out.values()
    ((name, fault),) = faults.items()
    assert name == "a"
    assert fault.startswith("a.puck: ")
    assert "\n" not in fault


def test_a_folder_of_both_kinds_of_bags_is_divided() -> None:
    Path("bags").mkdir()
    cloud_bag(Path("bags/clouds.bag"), {"/points": [cloud(0)]})
    sqlite_bag(Path("bags/torn.db3"), [b"damaged"])
    Path("bags/drive.pcap").write_bytes(Path("drive.pcap").read_bytes())
    plan = Plan(checked(config := made("bags")), check_scenes=True)
    paths = {kind: scenes["options"]["path"] for kind, scenes in config["scene_sets"].items()}
    assert paths["recorded_clouds"] == "bags/clouds.bag"
    assert sorted(paths["recordings"]) == ["bags/drive.pcap", "bags/torn.db3"]
    assert list(plan.left_out) == ["recordings"]
    assert list(plan.left_out["recordings"]) == ["torn"]
    assert plan.datasets["recorded_clouds"].clouds == ("clouds_0000",)


def test_a_topic_of_several_is_chosen() -> None:
    cloud_bag(Path("two.mcap"), {"/a": [cloud(0)], "/b": [cloud(1), cloud(2)]})
    with pytest.raises(InputError, match=r"two.mcap: .*: /a, /b: choose one by --topic"):
        made("two.mcap")
    config = made("two.mcap", options={"topic": "/b"})
    assert config["scene_sets"]["recorded_clouds"]["options"] == {"path": "two.mcap", "topic": "/b"}
    both = made("two.mcap", "drive.pcap", options={"topic": "/b"})
    clouds = Plan(checked(both), check_scenes=True).datasets
    assert clouds["recorded_clouds"].clouds == ("two_0000", "two_0001")
    assert clouds["recordings"].clouds
    with pytest.raises(InputError, match="has no topic /c; it has /a, /b"):
        made("two.mcap", options={"topic": "/c"})
    with pytest.raises(InputError, match="--topic: only ROS bags have topics"):
        made("mine/a.npy", options={"topic": "/b"})


def test_a_sensor_of_several_is_chosen() -> None:
    packets = rows(spin(packets=600))
    frames = [ethernet(ipv4(udp(row), f"10.0.0.{k % 2}")) for k, row in enumerate(packets)]
    Path("two.pcap").write_bytes(pcap_of_frames(*frames))
    with pytest.raises(InputError, match=r"two.pcap: data packets of 2 streams .*: choose one"):
        made("two.pcap")
    config = made("two.pcap", options={"stream": "10.0.0.1"})
    options = {"path": "two.pcap", "stream": "10.0.0.1"}
    assert config["scene_sets"]["recordings"]["options"] == options
    assert Plan(checked(config), check_scenes=True).datasets["recordings"].clouds
    with pytest.raises(InputError, match="--stream: only for recordings"):
        made("mine/a.npy", options={"stream": "10.0.0.1"})


def test_codecs_of_ones_own_are_called_after_their_class() -> None:
    config = made("mine/a.npy", codecs=("draco", "mine.py:MyCodec"))
    assert config["codecs"] == {"draco": {}, "my_codec": {"class": "mine.py:MyCodec"}}


def test_rates_are_named_by_the_key_of_the_clouds_frame() -> None:
    scaled = made("mine/a.npy", codecs=("draco", "mine.py:MyCodec"), rates=("r1", "r4"))
    assert scaled["codecs"]["draco"] == {"rates": ["r1", "r4"]}
    assert scaled["codecs"]["my_codec"] == {"class": "mine.py:MyCodec"}
    metric = made("utm.las", rates=("10mm",))
    assert metric["codecs"]["draco"] == {"metric_rates": ["10mm"]}


def test_codecs_get_fewer_rates_where_all_would_take_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("puckbench.planning.user_files._BUDGET_S", 0.01)
    assert made("mine/a.npy")["codecs"]["draco"] == {"rates": ["r1", "r3", "r6", "r8"]}
    assert made("mine/a.npy", rates=("all",))["codecs"]["draco"] == {}


def test_what_a_shell_finds_beside_the_clouds_is_left_out_and_named() -> None:
    asked = UserRun(("mine/a.npy", "mine.py", "mine/b.xyz"), ("draco",), "out")
    config = asked.configuration()
    assert config["scene_sets"]["clouds"]["options"]["path"] == ["mine/a.npy", "mine/b.xyz"]
    assert config["unused"].keys() == {"mine.py", "unit of clouds"}
    assert config["unused"]["mine.py"].startswith("no cloud, mesh or recording there (.ply")


def test_a_studys_configuration_has_its_clouds_and_ones_own_codec() -> None:
    study = read_reference("default")
    config = study_configuration(study, ["mine.py:MyCodec"], "out", ["objects", "rooms_raw"])
    assert config["codecs"] == {"my_codec": {"class": "mine.py:MyCodec"}}
    assert list(config["datasets"]) == ["objects", "rooms_raw"]
    assert set(config["scene_sets"]) == {"objects", "raw_rooms"}
    assert config["figures"]["examples"] == {
        "object": "objects/airplane_02",
        "raw": "rooms_raw/Area_1_office_1",
    }
    assert "sensor_study" not in config
    assert config["results"] == "out"
    assert "anchor" not in config["bd_rate"], "the first codec is, as G-PCC is not among these"
    both = study_configuration(study, ["mine.py:MyCodec", "gpcc"], "out", ["objects"])
    assert both["bd_rate"]["anchor"] == "gpcc"
    theirs = study.about["configuration"]
    again = checked(config).as_json()
    for name in config["datasets"]:
        assert theirs["datasets"][name].items() <= again["datasets"][name].items()
    for name in config["scene_sets"]:
        assert again["scene_sets"][name] == theirs["scene_sets"][name]
    assert again["seed"] == theirs["seed"]
    assert "anywhere" not in config["datasets"]["objects"], "defaults are left to the program"


def test_a_line_break_in_the_command_adds_no_key_to_the_configuration(tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    write_configuration(file, {"seed": 1}, "puckbench run 'a\nseed: 99\n#.csv'")
    assert yaml.safe_load(file.read_text()) == {"seed": 1}


def test_an_edited_configuration_is_kept() -> None:
    path = Path("out/config.yaml")
    write_configuration(path, made("mine/a.npy"), "puckbench run mine/a.npy")
    write_configuration(path, made("mine/b.xyz"), "puckbench run mine/b.xyz")
    path.write_text(path.read_text() + "seed: 7\n")
    assert yaml.safe_load(path.read_text())["seed"] == 7
    with pytest.raises(InputError, match=r"was edited: run it \(puckbench run out/config"):
        write_configuration(path, made("mine/a.npy"), "puckbench run mine/a.npy")


BAD = {
    "none.ply": ["none.ply: no such file"],
    "mine.py": ["mine.py: no cloud, mesh or recording there"],
    "empty.xyz": ["scene empty", "empty.xyz: the cloud is empty"],
    "nan.npy": ["1 of 51 points are not finite"],
    "mine/a.npy --codecs darco": ["unknown codec 'darco'", "did you mean 'draco'"],
    "mine/a.npy --codecs draco draco": ["a codec is named twice"],
    "mine/a.npy --rates r77": ["--rates: codec draco has none of r77"],
    "mine/a.npy --rates 1mm": ["draco has none of 1mm", "r8): use --frame metric"],
    "utm.las --rates r3": ["draco has none of r3", "mm): use --frame scaled"],
    "mine/a.npy --frame metric --codecs primitives": ["no rates for clouds in metres"],
    "mine/a.npy --codecs metric.py:MyCodec": [
        "codec my_codec: has no rates for scaled clouds (--frame metric)"
    ],
    "mine/a.npy mine.py --strict": ["mine.py: no cloud, mesh or recording there"],
    "mine.py notes.md": ["mine.py: no cloud, mesh or recording there"],
    "mine/a.npy --datasets objects": ["--datasets: only with --study"],
    "mine/a.npy --study default --codecs draco": ["with --study only the study's clouds are coded"],
    "--study defualt --codecs draco": ["no reference results 'defualt'", "did you mean 'default'"],
    "--study default": ["--codecs: give the codecs to compare with default"],
    "--study default --codecs mine.py:MyCodec --datasets spin": [
        "--datasets: default has no data set 'spin'",
        "did you mean 'spins'",
    ],
    "--study default --codecs mine.py:MyCodec --points 7": ["--points: the study sets this"],
    "--study default --codecs puck --datasets objects": ["codec puck: codes the returns"],
    "--study default --codecs mine.py:MyCodec --datasets spins": [
        "codec my_codec: has no rates for clouds in metres"
    ],
    "--codecs draco": ["give files, a configuration, or a study (--study)"],
    "mine/a.npy --codecs puck": ["codec puck: codes the returns of a spinning sensor"],
    "mine/a.npy --peak 30": ["--peak: only for clouds in metres (--frame metric)"],
    "utm.las --peak -1": ["peak", "greater than 0"],
    "mine --out mine/out": ["--out mine/out: is inside mine"],
    "mine/a.npy mine/a.npy": ["a.npy: the file is named twice"],
    "mine/a.npy empty.xyz --strict": ["empty.xyz: the cloud is empty"],
    "none.yaml": ["none.yaml: no such file"],
    "some.yaml --codecs draco": ["--codecs: the configuration has a key for this: edit some.yaml"],
}


@pytest.mark.parametrize("words", BAD)
def test_a_fault_is_one_line_before_anything_runs(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("empty.xyz").touch()
    Path("notes.md").touch()
    Path("metric.py").write_text(OWN.replace('rates = {"r1": {}}', "rates = lengths(10)"))
    np.save("nan.npy", np.vstack([POINTS, [np.nan, 0, 0]]))
    assert main(["run", *words.split()]) == 2
    said = capsys.readouterr()
    (line,) = [line for line in said.err.splitlines() if "looked at" not in line]
    assert line.startswith("puckbench: ")
    assert all(part in line for part in BAD[words])
    assert not Path("out/config.yaml").exists()


def test_turns_with_poses_are_also_a_drive() -> None:
    times = np.arange(1.6e9 - 1, 1.6e9 + 5)
    Path("way.tum").write_bytes(tum_bytes(times, np.tile(np.eye(4), (len(times), 1, 1))))
    config = made("drive.pcap", codecs=("puck",), poses="way.tum", limit=5, rates=("10mm",))
    flow = Workflow(config, check_scenes=True)
    entry = flow.drives.entries["drive"]
    assert entry.clouds == {"drive": tuple(f"drive_{turn:04d}" for turn in range(1, 6))}
    assert entry.rates == {"puck": ("10mm",)}
    step = flow.step("drive_of_clouds", drives="drive", drive="drive").step
    assert step.poses == "way.tum"
    assert flow.plan.datasets["recordings"].clouds


def test_frames_with_poses_are_a_drive_in_metres(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "drive.pcap", "frames", "--format", "pcd"]) == 0
    count = len(list(Path("frames").glob("*.pcd")))
    Path("way.txt").write_bytes(kitti_bytes(np.tile(np.eye(4), (count, 1, 1))))
    config = made("frames", poses="way.txt")
    assert config["datasets"]["clouds"]["size"] == "metric"
    flow = Workflow(config, check_scenes=True)
    assert flow.drives.entries["drive"].clouds["drive"][:2] == ("000000", "000001")
    for words, fault in (
        (["mine/box.ply", "--poses", "way.txt"], "--poses: only for the turns of recordings"),
        (["frames", "--poses", "none.tum"], "none.tum: no such file"),
        (["frames", "--poses", "mine/b.xyz"], "mine/b.xyz: no poses: lines have 8 numbers"),
    ):
        capsys.readouterr()
        assert main(["run", *words, "--out", "new"]) == 2
        assert fault in capsys.readouterr().err
        assert not Path("new/config.yaml").exists()


def test_a_table_of_capture_is_coded_turn_by_turn_in_metres() -> None:
    assert main(["capture", "drive.pcap", "mine/returns.parquet"]) == 0
    table = read_return_table(Path("mine/returns.parquet"))
    config = made("mine/returns.parquet", codecs=(), limit=2)
    assert config["datasets"] == {
        "capture_tables": {"scene_set": "capture_tables", "make": "cloud", "size": "metric"}
    }
    assert list(config["codecs"]) == ["draco", "gpcc"]
    assert config["unused"]["capture_tables"].endswith("clouds are coded (--limit)")
    (name, *_) = config["scene_sets"]["capture_tables"]["select"]
    assert name == "returns_0001"  # the first turn is cut off
    scene = open_scene_set("capture_tables", {"path": "mine"}).load(name)
    turn, cloud = table.select(table["turn"] == 1), scene.cloud
    assert cloud is not None
    assert scene.time_s == turn["timestamp"].min()
    assert np.array_equal(cloud.xyz, np.column_stack([turn[axis] for axis in "xyz"]))
    assert np.array_equal(cloud.fields["reflectivity"], turn["reflectivity"])
    with pytest.raises(InputError, match=r"codec puck: .*returns"):
        made("mine/returns.parquet", codecs=("puck",))
    both = made("mine/returns.parquet", codecs=("draco", "puck"))
    assert list(both["codecs"]) == ["draco"]
    assert "returns" in both["unused"]["codec puck"]
    assert "\n" not in both["unused"]["codec puck"]
    with pytest.raises(InputError, match=r"codec puck: .*returns"):
        made("mine/returns.parquet", codecs=("draco", "puck"), strict=True)


def test_other_tables_are_left_out() -> None:
    Path("mine/other.parquet").write_bytes(b"PAR1")
    config = made("mine/other.parquet", "mine/a.npy")
    assert config["unused"]["mine/other.parquet"].startswith("no cloud, mesh or recording there")
