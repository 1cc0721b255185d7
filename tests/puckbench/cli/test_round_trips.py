"""Decoded clouds with the place, header and attributes of the clouds that were coded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from puckbench.geometry.matching import match_points
from tests.cloud_files.test_cloud_formats import UTM, write_las
from tests.support.las_files import geo_keys, las_bytes

OF_FOOT = 0.3048


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_las(Path("site.las"))
    write_las(Path("site.laz"))
    return Path("site.las")


def _done(*words: object) -> dict[str, Any]:
    from contextlib import redirect_stdout
    from io import StringIO

    with redirect_stdout(StringIO()) as out:
        assert main([*map(str, words), "--json"]) == 0
    row: dict[str, Any] = json.loads(out.getvalue().splitlines()[-1])
    return row


def _coded(cloud: Path, codec: str, rate: str, *words: object) -> Path:
    _done("encode", cloud, "coded.bin", "--codec", codec, "--rate", rate, *words)
    return Path("coded.bin")


@pytest.mark.parametrize("codec", ["laz", "gpcc", "draco"])
@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_a_las_file_comes_back_as_it_was(site: Path, codec: str, suffix: str) -> None:
    original = site.with_suffix(f".{suffix}")
    stream = _coded(original, codec, "1mm")
    row = _done("decode", stream, f"back.{suffix}", "--like", original)
    assert row["attributes_by"] == ("order" if codec == "laz" else "position")
    assert row["attributes_lost"] == row["attributes_unknown"] == 0
    before, after = laspy.read(original), laspy.read(f"back.{suffix}")
    order = [np.lexsort((las.X, las.gps_time)) for las in (before, after)]
    assert np.array_equal(before.points.array[order[0]], after.points.array[order[1]])
    for name in ("version", "point_format", "system_identifier", "uuid", "creation_date"):
        assert getattr(before.header, name) == getattr(after.header, name), name
    for name in ("scales", "offsets", "mins", "maxs"):
        assert np.array_equal(getattr(before.header, name), getattr(after.header, name)), name
    assert list(after.point_format.extra_dimension_names) == ["amplitude"]


def test_a_prepared_cloud_has_the_place_and_the_original_the_attributes(site: Path) -> None:
    for rate, words in (("1mm", []), ("r8", [])):
        stream = _coded(site, "gpcc", rate, "--prepare", "ready.ply", *words)
        like = ("--like", "ready.ply", "--like", site)
        row = _done("decode", stream, "back.las", *like)
        las = laspy.read("back.las")
        rows = np.rint(las.gps_time - 0.25).astype(int)
        assert sorted(rows) == list(range(40))
        assert row["attributes_by"] == "position"
        assert np.abs(las.xyz - UTM[rows]).max() < (2e-3 if rate == "1mm" else 0.05)


def test_points_that_preparing_has_rounded_keep_their_attributes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    xyz = np.random.default_rng(0).random((20_000, 3)) * 100
    fields = {"intensity": np.full(len(xyz), 7, np.float32)}
    write_cloud(Path("wide.ply"), PointCloud(xyz, fields=fields))
    _done("prepare", "wide.ply", "ready.ply")
    stream = _coded(Path("ready.ply"), "draco", "r8")
    row = _done("decode", stream, "back.ply", "--like", "ready.ply", "--like", "wide.ply")
    assert row["attributes_lost"] == row["attributes_unknown"] == 0


def test_attributes_of_merged_points_are_lost_and_counted(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream = _coded(site, "gpcc", "10m")
    capsys.readouterr()
    row = _done("decode", stream, "back.las", "--like", site)
    points = row["points_out"]
    assert 0 < points < 40
    assert (row["attributes_lost"], row["attributes_unknown"]) == (40 - points, 0)
    output = capsys.readouterr().err
    assert f"back.las: {40 - points} of 40 points lost their attributes (merged" in output
    assert output.count("\n") == 1
    las = laspy.read("back.las")
    rows = np.rint(las.gps_time - 0.25).astype(int)
    assert len(set(rows)) == points
    assert np.abs(las.xyz - UTM[rows]).max() <= 5.001
    assert np.array_equal(las.amplitude, laspy.read(site).amplitude[rows])


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_other_clouds_keep_their_attributes_in_a_ply(site: Path, suffix: str) -> None:
    original = Path("cloud").with_suffix(suffix)
    values = np.arange(40, dtype=np.float32)
    if suffix == ".ply":
        fields = {"intensity": values}
        colours = np.column_stack([np.arange(40, dtype=np.uint8)] * 3)
        cloud = PointCloud(UTM - UTM[0], colours=colours, fields=fields)
        write_cloud(original, cloud, describe=False)
    else:
        from cloud_files.pcd import write_pcd

        axes = dict(zip("xyz", (UTM - UTM[0]).T, strict=True))
        write_pcd(original, {**axes, "intensity": values})
    stream = _coded(original, "draco", "0.5mm", "--frame", "metric")
    _done("decode", stream, "back.ply", "--like", original)
    back = read_cloud("back.ply")
    rows = back.fields["intensity"].astype(int)
    assert np.abs(back.xyz - (UTM - UTM[0])[rows]).max() <= 0.3e-3
    if suffix == ".ply":
        assert back.colours is not None
        assert np.array_equal(back.colours[:, 0], rows)


def test_a_las_file_in_feet_comes_back_in_feet(site: Path) -> None:
    steps = np.random.default_rng(1).integers(0, 5000, (30, 3))
    Path("feet.las").write_bytes(
        las_bytes(steps.tolist(), [geo_keys((3072, 32767), (3076, 9002), (4099, 9002))])
    )
    stream = _coded(Path("feet.las"), "laz", "1mm")
    _done("decode", stream, "back.las", "--like", "feet.las")
    assert np.abs(read_cloud("feet.las").xyz - steps * 0.01 * OF_FOOT).max() < 1e-9
    las = laspy.read("back.las")
    assert np.array_equal(np.column_stack([las.X, las.Y, las.Z]), steps)
    records = [laspy.read(name).vlrs[0].record_data_bytes() for name in ("feet.las", "back.las")]
    assert records[0] == records[1]


def test_what_no_original_fits_is_one_line(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream = _coded(site, "draco", "1mm")
    write_cloud(Path("other.ply"), PointCloud(UTM + 1000), describe=False)
    write_cloud(Path("near.ply"), PointCloud(UTM[:3] + 1), describe=False)
    capsys.readouterr()
    for out, like, fault in (
        ("back.ply", ["other.ply"], "coded.bin: not coded from other.ply, unless from a prepared"),
        (
            "back.ply",
            ["near.ply"],
            "100% of the decoded points lie more than 0.00173 m off its points",
        ),
        ("back.las", ["other.ply"], "coded.bin: not coded from other.ply, unless from a prepared"),
        ("back.copc.laz", [], "back.copc.laz: COPC files are not written: name it .laz"),
        ("back.copc.laz", ["site.las"], "back.copc.laz: COPC files are not written"),
        ("back.las", ["site.las", "site.laz"], "--like: takes one prepared cloud and one original"),
        ("back.las", ["none.las"], "none.las: no such file"),
    ):
        words = [word for path in like for word in ("--like", path)]
        assert main(["decode", str(stream), out, *words]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert fault in line
        assert not Path(out).exists()


def test_points_are_matched_by_order_only_if_all_agree() -> None:
    original = np.random.default_rng(3).random((500, 3))
    moved = original + np.random.default_rng(4).uniform(-0.4, 0.4, original.shape) * 1e-3
    match = match_points(original, moved, 1e-3)
    assert (match.by, match.unused) == ("order", 0)
    mixed = np.random.default_rng(5).permutation(500)
    match = match_points(original, moved[mixed], 1e-3)
    assert match.by == "position"
    assert np.array_equal(match.rows, mixed)


def test_points_within_the_reach_in_another_order_are_matched_by_position() -> None:
    original = np.random.default_rng(3).random((50, 3))
    mixed = np.random.default_rng(5).permutation(50)
    match = match_points(original, original[mixed], 2.0)
    assert match.by == "position"
    assert np.array_equal(match.rows, mixed)


def test_points_at_one_place_each_have_an_original() -> None:
    original = np.array([[0, 0, 0], [0, 0, 0], [0.1, 0, 0], [5, 0, 0], [9, 0, 0.0]])
    decoded = np.array([[5, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [20, 0, 0], [5, 0, 0.0]])
    match = match_points(original, decoded, 1.0)
    assert sorted(match.rows[1:4].tolist()) == [0, 1, 2]
    assert match.rows[[0, 4, 5]].tolist() == [3, -1, 3]
    assert match.unused == 1
