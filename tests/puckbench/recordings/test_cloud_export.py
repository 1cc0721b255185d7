"""Files of clouds in other formats."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from cloud_files.pcd import write_pcd
from cloud_files.text import write_csv
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from tests.puckbench.cli.test_round_trips import _done
from tests.support.las_files import las_bytes

RANDOM = np.random.default_rng(0)
XYZ = np.round(RANDOM.uniform(-50, 50, (40, 3)), 3)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_pcd_becomes_a_las_file_with_all_its_fields() -> None:
    fields = {
        "intensity": np.arange(40, dtype=np.float32),
        "ring": np.arange(40, dtype=np.uint16) % 16,
        "time": np.arange(40) / 1000,
        "range": np.linalg.norm(XYZ, axis=1).astype(np.float32),
        "classification": np.full(40, 7, np.uint8),
    }
    write_pcd("x.pcd", {**dict(zip("xyz", XYZ.T, strict=True)), **fields})
    assert _done("export", "x.pcd", "out.las")["points"] == 40
    las = laspy.read("out.las")
    assert np.abs(las.xyz - XYZ).max() < 1e-4
    names = {"intensity": "intensity", "user_data": "ring", "gps_time": "time", "range": "range"}
    for name, field in {**names, "classification": "classification"}.items():
        assert np.array_equal(las[name], fields[field]), name
    assert list(las.point_format.extra_dimension_names) == ["range"]


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("has_colours", [False, True])
@pytest.mark.parametrize("largest", [31, 32, 255, 256])
def test_classes_above_31_are_those_of_the_file(
    largest: int, has_colours: bool, suffix: str
) -> None:
    """Point formats 0 to 5 have 5 bits for them, formats 6 and 7 of LAS 1.4 have 8."""
    classes = np.append(np.arange(39) % 31, largest).astype(np.float32)
    columns = {"classification": classes, "return_number": np.arange(40) % 7 + 1}
    if has_colours:
        columns |= {name: np.arange(40, dtype=np.uint8) for name in ("red", "green", "blue")}
    write_csv("x.csv", {**dict(zip("xyz", XYZ.T, strict=True)), **columns})
    _done("export", "x.csv", f"out.{suffix}")
    las = laspy.read(f"out.{suffix}")
    is_wide = 31 < largest < 256
    assert las.point_format.id == {False: (1, 3), True: (6, 7)}[is_wide][has_colours]
    assert las.header.version.minor == (4 if is_wide else 2)
    name = "classification" if largest < 256 else "classification_"
    assert np.array_equal(las[name], classes)
    assert np.array_equal(las.return_number, columns["return_number"])
    assert np.abs(las.xyz - XYZ).max() < 1e-4
    assert not [*las.point_format.extra_dimension_names][largest == 256 :]


@pytest.mark.parametrize("suffix", ["ply", "pcd", "csv", "las", "laz"])
def test_attributes_remain_in_every_format_that_has_a_place_for_them(suffix: str) -> None:
    colours = RANDOM.integers(0, 256, (40, 3), np.uint8)
    fields = {"intensity": np.arange(40, dtype=np.uint16), "echo": np.arange(40, dtype=np.int16)}
    write_cloud("x.ply", PointCloud(XYZ, colours=colours, fields=fields), describe=False)
    _done("export", "x.ply", f"out.{suffix}")
    back = read_cloud(f"out.{suffix}")
    assert np.abs(back.xyz - XYZ).max() < 1e-4
    assert np.array_equal(back.colours, colours)
    for name, values in fields.items():
        assert np.array_equal(back.fields[name], values), name


@pytest.mark.parametrize("suffix", ["ply", "pcd", "csv"])
@pytest.mark.parametrize("factor", [256, 257, 1000])
def test_colours_of_16_bits_go_out_of_las_and_back(suffix: str, factor: int) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = np.full(3, 1e-3)
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(40, header=header))
    las.x, las.y, las.z = XYZ.T
    for name in ("red", "green", "blue"):
        las[name] = RANDOM.integers(0, 65, 40) * factor
    las.write("site.las")
    _done("export", "site.las", f"out.{suffix}")
    _done("export", f"out.{suffix}", "back.las")
    back = laspy.read("back.las")
    for name in ("red", "green", "blue"):
        assert np.array_equal(back[name], las[name])
    assert not list(back.point_format.extra_dimension_names)


def test_a_las_file_becomes_a_laz_file_with_header_and_records() -> None:
    records = [("mine", 7, b"x")]
    steps = RANDOM.integers(0, 5000, (30, 3))
    Path("site.las").write_bytes(las_bytes(steps.tolist(), records))
    _done("export", "site.las", "out.laz")
    _done("export", "out.laz", "back.las")
    before, after = laspy.read("site.las"), laspy.read("back.las")
    assert before.points.array.tobytes() == after.points.array.tobytes()
    assert [record.user_id for record in after.vlrs] == ["mine"]


def test_what_kittis_format_has_no_place_for_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    fields = {"intensity": np.arange(40, dtype=np.uint8), "ring": np.arange(40) % 16}
    write_cloud("x.ply", PointCloud(XYZ, fields=fields), describe=False)
    assert main(["export", "x.ply", "out.bin"]) == 0
    assert "out.bin: without ring, for which the format has no place" in capsys.readouterr().err
    back = read_cloud("out.bin", bin_columns="4")
    assert back.fields["intensity"] == pytest.approx(np.arange(40) / 255)
    _done("export", "out.bin", "out.las")  # shares of 1 are scaled
    assert laspy.read("out.las").intensity.max() == pytest.approx(39 / 255 * 65535, abs=1)


def test_formats_of_scans_and_options_of_recordings_are_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_cloud("x.ply", PointCloud(XYZ), describe=False)
    for words, fault in (
        (["x.evd"], "x.evd: a cloud lacks the columns of a scan"),
        (["x.las", "--turns", "1"], "x.ply: --turns is for recordings"),
        (["x.las", "--clean"], "--clean: is for scans (x.ply)"),
        (["x.obj"], "x.obj: unknown suffix '.obj'"),
    ):
        assert main(["export", "x.ply", *words]) == 2
        assert fault in capsys.readouterr().err
        assert [path.name for path in Path().iterdir()] == ["x.ply"]
