"""What a cloud's coordinates are: rates and PSNRs that hang on it, and files that are no clouds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cloud_files.clouds import read_cloud, write_cloud
from cloud_files.meshes import read_mesh, write_mesh
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from puckbench.library import compare, open_codec, prepare
from tests.cloud_files.test_cloud_formats import write_las

UTM = np.array([500_000.0, 5_000_000.0, 120.0])
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"


@pytest.fixture
def sphere(tmp_path: Path) -> Path:
    """A cloud of a unit sphere in metres, without a description."""
    points = np.random.default_rng(0).normal(size=(2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    path = tmp_path / "sphere.ply"
    write_cloud(path, PointCloud(points), describe=False)
    return path


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    (tmp_path / "mesh.obj").write_text(OBJ)
    write_mesh(tmp_path / "mesh.ply", read_mesh(tmp_path / "mesh.obj"))
    return tmp_path / "mesh.ply"


def _json(capsys: pytest.CaptureFixture[str], *words: object) -> dict:
    capsys.readouterr()
    assert main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def _refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main([*map(str, words)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize("codec", ["gpcc", "sparse_octree_net", "pcgcv2_plus"])
def test_rates_in_grid_units_need_a_scaled_cloud(
    codec: str, sphere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = sphere.with_suffix(".bin")
    fault = _refused(capsys, "encode", sphere, out, "--codec", codec, "--rate", "r4")
    assert "sphere.ply: codec" in fault
    assert all(way in fault for way in ("puckbench prepare", "--prepare", "--frame scaled"))
    assert not out.exists()


def test_a_prepared_cloud_a_unit_or_a_word_tell_the_frame(
    sphere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ready, out = sphere.with_name("ready.ply"), sphere.with_suffix(".bin")
    coding = [out, "--codec", "gpcc", "--rate", "r4"]
    result = _json(capsys, "encode", sphere, *coding, "--prepare", ready)
    assert result["bytes"] > 3000
    row = _json(capsys, "evaluate", ready, out)
    assert row["d1_psnr"] == pytest.approx(10 * np.log10(3 * 1023**2 / row["d1_mse"]))
    assert _json(capsys, "encode", ready, *coding)["bytes"] == result["bytes"]
    said = json.dumps({"options": {"unit": 0.001}})
    assert _json(capsys, "encode", sphere, *coding, "--entry", said)["bytes"] > 3000
    assert np.abs(read_cloud(sphere).xyz).max() < 1.1
    assert _json(capsys, "encode", sphere, *coding, "--frame", "scaled")["bytes"] < 100


def test_a_metric_cloud_is_no_scaled_one(sphere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    metric = sphere.with_name("metric.ply")
    _json(capsys, "prepare", sphere, metric, "--scale", 0)
    out = sphere.with_suffix(".bin")
    fault = _refused(capsys, "encode", metric, out, "--codec", "gpcc", "--rate", "r4")
    assert "the cloud is in metres" in fault
    assert "--frame scaled" not in fault
    assert _json(capsys, "encode", metric, out, "--codec", "draco", "--rate", "r8")["bytes"]


def test_a_rate_is_any_length(sphere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    metric, out = sphere.with_name("metric.ply"), sphere.with_suffix(".bin")
    coding = ["--codec", "draco", "--rate"]
    row = _json(capsys, "encode", sphere, out, *coding, "0.3cm", "--prepare", metric)
    assert row["rate"] == "3mm"
    error = _json(capsys, "evaluate", metric, out)["d1_rms_m"]
    assert error == pytest.approx(0.003 / 2, rel=0.05)  # 3 axes, each uniform within the step
    fault = _refused(capsys, "encode", metric, out, *coding, "0mm")
    assert "--rate: codec draco: rate '0mm': a length must be from 0.001mm to 100m" in fault


@pytest.mark.parametrize(("words", "peak"), [([], 30.0), (["--peak", 59.7], 59.7)])
def test_a_cloud_in_metres_has_a_psnr_and_says_its_peak(
    sphere: Path, capsys: pytest.CaptureFixture[str], words: list[object], peak: float
) -> None:
    metric, out = sphere.with_name("metric.ply"), sphere.with_suffix(".bin")
    assert _json(capsys, "prepare", sphere, metric, "--scale", 0, *words)["peak"] == peak
    _json(capsys, "encode", metric, out, "--codec", "draco", "--rate", "10mm")
    row = _json(capsys, "evaluate", metric, out)
    assert row["peak"] == peak
    assert row["d1_psnr"] == pytest.approx(10 * np.log10(3 * peak**2 / row["d1_mse"]))
    assert _json(capsys, "evaluate", metric, out, "--peak", 7)["peak"] == 7


def test_a_scaled_cloud_has_the_peak_of_its_size(
    sphere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = sphere.with_name("out.ply")
    assert "peak: only for clouds in metres" in _refused(
        capsys, "prepare", sphere, out, "--peak", 2
    )
    assert not out.exists()


def test_the_peak_of_a_psnr_is_not_assumed(
    sphere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = sphere.with_suffix(".bin")
    _json(capsys, "encode", sphere, out, "--codec", "draco", "--rate", "r4")
    assert main(["evaluate", str(sphere), str(out), "--json"]) == 0
    output = capsys.readouterr()
    row = json.loads(output.out.splitlines()[-1])
    assert "d1_psnr" not in row
    assert "d1_psnr needs --peak" in output.err
    row = _json(capsys, "evaluate", sphere, out, "--peak", 2)
    assert row["d1_psnr"] == pytest.approx(10 * np.log10(3 * 4 / row["d1_mse"]))
    for wrong, fault in (
        ("0", "must be greater than 0"),
        ("-1", "must be greater than 0"),
        ("nan", "must be a finite number"),
    ):
        assert fault in _refused(capsys, "evaluate", sphere, out, "--peak", wrong)


def test_clouds_of_unlike_frames_are_told(
    sphere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.ply"
    for factor, is_warned in ((1.01, False), (100.0, True)):
        write_cloud(other, PointCloud(factor * read_cloud(sphere).xyz), describe=False)
        assert main(["evaluate", str(sphere), str(other)]) == 0
        assert ("are both in the same frame?" in capsys.readouterr().err) == is_warned


def test_a_library_compares_scaled_clouds_alone_by_rates_in_grid_units() -> None:
    points = np.random.default_rng(0).random((500, 3))
    with pytest.raises(InputError, match="codec gpcc: its rates are steps of a scaled"):
        compare(PointCloud(points), [open_codec("draco"), open_codec("gpcc")])
    scaled = PointCloud(1023 * points, about={"size": 1024})
    assert "d1_psnr" in compare(scaled, [open_codec("gpcc", {"rates": ["r4"]})])
    draco = [open_codec("draco", {"rates": ["r4"]})]
    assert "d1_psnr" not in compare(PointCloud(points), draco)
    assert "d1_psnr" in compare(PointCloud(points), draco, peak=1.0)
    assert set(compare(prepare(PointCloud(points), 0), draco)["peak"]) == {30}


def test_surveyed_coordinates_keep_their_precision(
    sphere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far = sphere.with_name("utm.ply")
    points = read_cloud(sphere).xyz + UTM
    write_cloud(far, PointCloud(points), describe=False)
    out, back = sphere.with_suffix(".bin"), sphere.with_name("back.ply")
    _json(capsys, "encode", far, out, "--codec", "draco", "--rate", "r8")
    assert _json(capsys, "decode", out, back)["codec"] == "draco"
    assert cKDTree(read_cloud(back).xyz).query(points)[0].max() < 3**0.5 * 2 / 2047


def test_a_mesh_is_no_cloud(sphere: Path, mesh: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = sphere.with_suffix(".bin")
    for words in (
        ["encode", mesh, out, "--codec", "draco", "--rate", "r4"],
        ["evaluate", sphere, mesh],
        ["evaluate", mesh, sphere],
        ["prepare", mesh, out],
    ):
        assert "mesh.ply: a mesh, not a cloud: sample or scan it first" in _refused(capsys, *words)
    fault = _refused(capsys, "sample", sphere, sphere.with_name("s.ply"))
    assert "sphere.ply: a cloud, not a mesh" in fault


def test_points_that_are_all_the_same_have_no_psnr_of_their_diameter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same, out = tmp_path / "same.ply", tmp_path / "same.bin"
    write_cloud(same, PointCloud(np.full((1000, 3), 0.3), about={"size": 1024}))
    _json(capsys, "encode", same, out, "--codec", "gpcc", "--rate", "r4")
    row = _json(capsys, "evaluate", same, out)
    assert row["cd_point"] > 0
    assert "cd_psnr_point" not in row


def test_points_have_no_primitives_to_recover(
    sphere: Path, mesh: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, labelled = sphere.with_suffix(".bin"), sphere.with_name("labelled.ply")
    _json(capsys, "encode", sphere, out, "--codec", "draco", "--rate", "r4")
    points = read_cloud(sphere).xyz
    write_cloud(labelled, PointCloud(points, labels=np.zeros(len(points), np.int32)))
    scene = sphere.with_name("scene.ply")
    _json(capsys, "scene", "embedded_objects", "chair_01", scene)
    fault = _refused(capsys, "recovery", out, labelled, scene)
    assert "sphere.bin: codec draco does not encode surfaces" in fault


@pytest.mark.parametrize("codec", ["laz", "cloudini"])
def test_codecs_with_lengths_alone_need_a_cloud_in_metres(codec: str) -> None:
    """A comparison of none of their rates once was an empty table."""
    points = np.random.default_rng(0).random((50, 3))
    with pytest.raises(InputError, match=r"does not say that it is in metres \(--frame metric\)"):
        compare(PointCloud(points), [open_codec(codec)])
    with pytest.raises(InputError, match="the cloud is scaled"):
        compare(PointCloud(points, about={"size": 1024}), [open_codec(codec)])
    assert len(compare(PointCloud(points, about={"size": 0}), [open_codec(codec)])) == 7


def test_a_survey_in_metres_needs_no_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_las(tmp_path / "site.las")
    words = ("encode", tmp_path / "site.las", tmp_path / "out.bin", "--codec", "draco")
    assert _json(capsys, *words, "--rate", "10mm")["points_in"] == 40
    fault = _refused(capsys, *words, "--rate", "10mm", "--frame", "scaled")
    assert "the cloud is scaled" in fault


def test_a_cloud_is_prepared_for_its_rate_and_its_place_comes_from_that_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site, metric, scaled = (tmp_path / name for name in ("site.las", "metric.ply", "scaled.ply"))
    streams = {ready: ready.with_suffix(".bin") for ready in (metric, scaled)}
    write_las(site)
    for ready, rate in ((metric, "10mm"), (scaled, "r4")):
        words = ("encode", site, streams[ready], "--codec", "gpcc", "--rate", rate)
        assert _json(capsys, *words, "--prepare", ready)["points_in"] == 40
    assert read_cloud(metric).frame == "metric"
    assert read_cloud(scaled).frame == "scaled"
    words = ("--codec", "gpcc", "--rate", "10mm", "--frame", "scaled", "--prepare")
    assert "is scaled" in _refused(
        capsys, "encode", site, tmp_path / "c.bin", *words, tmp_path / "c.ply"
    )
    assert not (tmp_path / "c.ply").exists()
    out = tmp_path / "out.ply"
    _json(capsys, "decode", streams[metric], out, "--like", metric)
    assert np.abs(read_cloud(out).xyz.min(axis=0) - read_cloud(site).xyz.min(axis=0)).max() < 0.02
    _json(capsys, "encode", site, streams[metric], "--codec", "gpcc", "--rate", "10mm")
    fault = _refused(capsys, "decode", streams[metric], out, "--like", scaled)
    assert "not coded from" in fault


@pytest.mark.parametrize("option", ["like", "mesh"])
def test_decoded_points_are_placed_by_a_described_cloud(
    option: str, sphere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream, bare = tmp_path / "out.bin", tmp_path / "bare.xyz"
    np.savetxt(bare, np.eye(3))
    _json(capsys, "encode", sphere, stream, "--codec", "draco", "--rate", "r4")
    words = ["--like", bare] if option == "like" else ["--like", sphere, "--as-mesh"]
    fault = _refused(capsys, "decode", stream, tmp_path / "out.ply", *words)
    assert ("unless from a prepared cloud" if option == "like" else "not with --as-mesh") in fault
