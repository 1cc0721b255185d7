"""The command line: names and outputs that others rely on, and bad input in one line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from cloud_files.meshes import read_mesh, write_mesh
from pointkit.geometry.cloud import PointCloud, UncheckedCloud
from puckbench.cli import main
from puckbench.cli.registry import help_texts

BOX = """OFF
8 6 0
0 0 0
4 0 0
4 3 0
0 3 0
0 0 2.5
4 0 2.5
4 3 2.5
0 3 2.5
4 0 1 2 3
4 7 6 5 4
4 0 4 5 1
4 1 5 6 2
4 2 6 7 3
4 3 7 4 0
"""
POINT_KEYS = {"acd_ab_point", "acd_ba_point", "cd_point", "d1_mse", "hausdorff_point"}
PLANE_KEYS = {"acd_ab_plane", "acd_ba_plane", "cd_plane", "d2_mse", "hausdorff_plane"}
OTHER_KEYS = {"cd_psnr_point", "cd_psnr_plane", "points_a", "points_b"}


@pytest.fixture
def room(tmp_path: Path) -> Path:
    path = tmp_path / "room.off"
    path.write_text(BOX)
    return path


@pytest.fixture
def cloud(tmp_path: Path) -> Path:
    path = tmp_path / "cloud.ply"
    points = np.random.default_rng(0).random((500, 3)) * 1023
    write_cloud(path, PointCloud(points, about={"size": 1024}))
    return path


def _json(capsys: pytest.CaptureFixture[str], *words: object) -> dict:
    capsys.readouterr()
    assert main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def _refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main([str(word) for word in words]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("puckbench: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_a_scan_by_hand_from_mesh_to_distortion(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan, ready, stream = (tmp_path / name for name in ("s.parquet", "r.ply", "r.bin"))
    sweep = json.dumps({"duration_s": 0.1, "azimuth_step_deg": 1.0})
    result = _json(capsys, "scan", room, scan, "--errors", "vlp16", "--sweep", sweep)
    assert result["returns"] == 12 * 15 * 16
    assert result["origin"][2] == pytest.approx(1.3)
    prepared = _json(capsys, "prepare", scan, ready, "--crop", 0, 0, 0, 4, 3, 2.5, "--scale", 1024)
    assert prepared["points"] == result["returns"]
    coded = _json(capsys, "encode", ready, stream, "--codec", "draco", "--rate", "r8")
    assert coded["bytes"] == stream.stat().st_size
    assert coded["bpp"] == 8 * coded["bytes"] / coded["points_in"]
    _json(capsys, "decode", stream, tmp_path / "d.ply")
    measured = _json(capsys, "evaluate", ready, tmp_path / "d.ply", "--truth", room)
    expected = POINT_KEYS | PLANE_KEYS | OTHER_KEYS
    assert expected | {f"truth_{key}" for key in POINT_KEYS | PLANE_KEYS} <= measured.keys()
    step = 1023 / 2047
    assert measured["cd_plane"] == pytest.approx(step**2 / 12, rel=0.3)
    noise_m = measured["truth_acd_ba_plane"] ** 0.5 / prepared["scale"]
    assert noise_m == pytest.approx(0.0172, rel=0.25)  # hypot(0.014, 0.010), less by incidence


def test_gpcc_streams_with_and_without_what_puckbench_adds(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ours, bare = tmp_path / "ours.bin", tmp_path / "bare.bin"
    for stream, how in ((ours, []), (bare, ["--raw"])):
        _json(capsys, "encode", cloud, stream, "--codec", "gpcc", "--rate", "r4", *how)
    assert ours.read_bytes().endswith(bare.read_bytes())
    result = _json(capsys, "decode", ours, tmp_path / "a.ply")
    read = _json(capsys, "decode", bare, tmp_path / "b.ply", "--codec", "gpcc")
    assert result["codec"] == "gpcc"
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    assert result["points_out"] == read["points_out"] > 0


def test_evaluating_a_stream_gives_the_whole_row(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream = tmp_path / "a.bin"
    _json(capsys, "encode", cloud, stream, "--codec", "draco", "--rate", "r4")
    row = _json(capsys, "evaluate", cloud, stream, "--dataset", "d", "--row", tmp_path / "row.json")
    assert row == json.loads((tmp_path / "row.json").read_text())
    assert (row["dataset"], row["cloud"], row["codec"], row["rate"]) == (
        "d",
        "cloud",
        "draco",
        "r4",
    )
    assert {"bpp", "encode_s", "decode_s", "points_in", "points_out", "codec_version"} <= row.keys()
    assert "cd_plane" not in row  # the cloud has no normals


def test_identical_clouds_have_no_error_and_no_psnr(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row = _json(capsys, "evaluate", cloud, cloud)
    assert row["cd_point"] == 0
    assert "d1_psnr" not in row


def test_a_cloud_as_truth_is_measured_like_a_reference(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream = tmp_path / "a.bin"
    _json(capsys, "encode", cloud, stream, "--codec", "draco", "--rate", "r3")
    row = _json(capsys, "evaluate", cloud, stream, "--truth", cloud)
    assert row["truth_cd_point"] == row["cd_point"] > 0
    assert row["truth_hausdorff_point"] == row["hausdorff_point"]


def test_sampling_is_seeded(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        _json(capsys, "sample", room, tmp_path / f"{name}.ply", "--points", 100, "--seed", seed)
    bytes_of = {name: (tmp_path / f"{name}.ply").read_bytes() for name in "abc"}
    assert bytes_of["a"] == bytes_of["b"] != bytes_of["c"]


def test_a_scene_comes_with_its_description(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = json.dumps({"detail": 0.3})
    out = tmp_path / "room.ply"
    _json(capsys, "scene", "embedded_rooms", "copy_room_1", out, "--options", options, "--seed", 3)
    about = json.loads((tmp_path / "room.json").read_text())
    assert about["group"] == "copy_room"
    assert np.shape(about["box"]) == (2, 3)
    assert np.shape(about["origin"]) == (3,)
    assert {item["semantic"] for item in about["objects"]} >= {"wall", "floor", "ceiling"}


def test_metres_of_an_unscaled_prepared_cloud(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _json(capsys, "prepare", cloud, tmp_path / "p.ply", "--scale", 0)
    assert np.array_equal(read_cloud(tmp_path / "p.ply").xyz, read_cloud(cloud).xyz)


def test_codecs_and_datasets_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    codecs = _json(capsys, "codecs")
    assert codecs["draco"]["available"] is True
    assert list(codecs["draco"]["rates"]) == [f"r{n}" for n in range(1, 9)]
    assert {"embedded_rooms", "capod", "mesh_files", "s3dis"} <= _json(capsys, "datasets").keys()
    assert main(["codecs"]) == 0
    lines = capsys.readouterr().out.splitlines()
    draco = "  draco               r1 to r8; 100mm to 1mm   a fast baseline that everybody has"
    assert draco in lines
    assert max(map(len, lines)) <= 120
    assert main(["codecs", "draco"]) == 0
    assert "  r1   4\n" in capsys.readouterr().out
    assert "did you mean 'draco'?" in _refused(capsys, "codecs", "drako")


def test_what_is_there_of_a_data_set_is_counted(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "Area_1" / "office_1").mkdir(parents=True)
    (tmp_path / "Area_1" / "office_1" / "office_1.txt").write_text("1 2 3 4 5 6\n")
    options = json.dumps({"path": str(tmp_path)})
    counted = _json(capsys, "datasets", "--check", "s3dis", "--options", options)
    assert counted["scenes"] == 1
    assert counted["Area_1"] == "1 of 44 published, which differs"
    members = _json(capsys, "datasets", "--check", "embedded_objects", "--options", "{}")
    assert members == {"scenes": 180}


def test_help_names_every_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "puckbench", "--help"], capture_output=True, text=True, check=True
    )
    assert all(command in done.stdout for command in help_texts())


@pytest.mark.parametrize("words", [["codecs"], ["codecs", "--json"], []])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_gone_is_no_error(words: list[str], unbuffered: str) -> None:
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as gone:
        done = subprocess.run(
            [sys.executable, "-m", "puckbench", *words],
            stdout=gone,
            stderr=subprocess.PIPE,
            env=environment,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("command", help_texts())
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main([command, "--help"])
    assert "usage: puckbench" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["encode", "none.ply", "o.bin", "--codec", "draco", "--rate", "r1"], "none.ply: no such"),
        (["encode", "{cloud}", "o.bin", "--codec", "drako", "--rate", "r1"], "codec 'drako'"),
        (["encode", "{cloud}", "o.bin", "--codec", "draco", "--rate", "r0"], "rate 'r0'"),
        (["decode", "{cloud}", "o.ply"], "cloud.ply: no codec recognises the stream"),
        (["decode", "{cut}", "o.ply"], "cut.bin: codec draco: the stream is"),
        (["decode", "none.bin", "o.ply"], "none.bin: no such file"),
        (["evaluate", "{cloud}", "none.ply"], "none.ply: no such file"),
        (["evaluate", "{cloud}", "{cloud}", "--truth", "none.obj"], "none.obj: no such file"),
        (["scan", "none.obj", "o.parquet"], "none.obj: no such file"),
        (["scan", "{room}", "o.parquet", "--errors", "wobble"], "unknown error model 'wobble'"),
        (
            ["scan", "{room}", "o.parquet", "--origin", "900", "0", "0"],
            "is outside the scene: 0% of all",
        ),
        (["sample", "{cloud}", "o.ply"], "cloud.ply"),
        (["prepare", "{cloud}", "o.ply", "--crop", "1", "2"], "six numbers"),
        (["prepare", "{cloud}", "o.ply", "--crop", "-9", "-9", "-9", "-8", "-8", "-8"], "no point"),
        (["prepare", "{mesh}", "o.ply"], "mesh.ply: a mesh, not a cloud"),
        (["prepare", "{cloud}", "o.ply", "--turns", "2-1"], "last turn is before the first"),
        (["prepare", "{nan}", "o.ply"], "nan.ply: 1 of 2 points are not finite"),
        (["figure", "fig_9_9", "o.pdf", "--inputs", "{{}}"], "unknown figure 'fig_9_9'"),
        (["scene", "embedded_rooms", "cellar", "o.ply"], "cellar"),
        (["scene", "cellars", "x", "o.ply"], "unknown loader 'cellars'"),
        (["data", "everything", "--folder", "{folder}"], "no data set 'everything'"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    words: list[str],
    fault: str,
    room: Path,
    cloud: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_cloud(tmp_path / "nan.ply", UncheckedCloud(np.array([[0, 0, 0], [np.nan, 0, 0]])))
    main(["encode", str(cloud), str(tmp_path / "cut.bin"), "--codec", "draco", "--rate", "r1"])
    stream = (tmp_path / "cut.bin").read_bytes()
    (tmp_path / "cut.bin").write_bytes(stream[: len(stream) // 2])
    write_mesh(tmp_path / "mesh.ply", read_mesh(room))
    places = {
        "mesh": tmp_path / "mesh.ply",
        "nan": tmp_path / "nan.ply",
        "cut": tmp_path / "cut.bin",
        "folder": tmp_path,
    }
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    arguments = [word.format(room=room, cloud=cloud, **places) for word in words]
    assert fault in _refused(capsys, *arguments)
    assert list((tmp_path / "here").iterdir()) == []


@pytest.mark.parametrize("words", [["sample", "a", "b", "--points", "0"], ["encode"], ["fly"]])
def test_bad_usage_has_status_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("puckbench: ")
    assert words[0] in line
