"""LAS and LAZ files of all kinds come back by `decode --like` with units and attributes."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

from cloud_files.ply import read_ply
from puckbench.cli import main
from tests.puckbench.cli.test_round_trips import _coded, _done
from tests.support.las_files import geo_keys, las_bytes

FORMATS = [
    *((number, "1.2") for number in range(4)),
    (4, "1.3"),
    (5, "1.3"),
    *((number, "1.4") for number in (1, 3, 5, *range(6, 11))),
]
CHANNEL = 0x30
"""Bits of the scanner channel in byte 15 of points of format 6 and later."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _points(header: laspy.LasHeader, steps: np.ndarray) -> laspy.LasData:
    """Points with random bytes in all further fields, numbered by `user_data`."""
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(steps), header=header))
    record = las.points.array
    noise = np.random.default_rng(1).integers(0, 256, (len(steps), record.itemsize), np.uint8)
    if header.point_format.id >= 6:
        noise[:, 15] &= ~np.uint8(CHANNEL)
    record[:] = noise.view(record.dtype)[:, 0]
    las.X, las.Y, las.Z = steps.T
    las.user_data = np.arange(len(steps)) % 256
    return las


def _steps(points: int = 60, most: int = 10_000) -> np.ndarray:
    return np.random.default_rng(0).integers(0, most, (points, 3))


def _sorted(path: str) -> Any:
    las = laspy.read(path)
    return las.points.array[np.argsort(las.user_data, kind="stable")].tobytes()


@pytest.mark.parametrize(("number", "version"), FORMATS)
@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_every_point_format_comes_back(number: int, version: str, suffix: str) -> None:
    header = laspy.LasHeader(point_format=number, version=version)
    header.scales, header.offsets = [0.001, 0.002, 0.0005], [500_000.25, 5e6, -10]
    header.add_extra_dim(laspy.ExtraBytesParams("three", "3u1"))
    scaled = laspy.ExtraBytesParams("scaled", "u2", scales=np.array([0.01]), offsets=np.array([5]))
    header.add_extra_dim(scaled)
    _points(header, _steps()).write("site.las")
    stream = _coded(Path("site.las"), "gpcc", "0.1mm")
    row = _done("decode", stream, f"back.{suffix}", "--like", "site.las")
    assert row["attributes_by"] == "position"
    assert (row["attributes_lost"], row["attributes_unknown"]) == (0, 0)
    assert _sorted("site.las") == _sorted(f"back.{suffix}")


@pytest.mark.parametrize("number", [9, 10])
def test_waveforms_that_laz_would_damage_are_refused(
    number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    header = laspy.LasHeader(point_format=number, version="1.4")
    las = _points(header, _steps())
    las.scanner_channel = np.arange(60) % 4
    las.write("site.las")
    stream = _coded(Path("site.las"), "laz", "1mm")
    assert main(["decode", str(stream), "back.laz", "--like", "site.las"]) == 2
    assert capsys.readouterr().err == (
        "puckbench: back.laz: its waveforms cannot be written as LAZ: name it .las\n"
    )
    assert not Path("back.laz").exists()
    _done("decode", stream, "back.las", "--like", "site.las")
    assert _sorted("site.las") == _sorted("back.las")


@pytest.mark.parametrize(
    ("codec", "rate", "size"),
    [("laz", "1mm", 0), ("gpcc", "1mm", 0), ("draco", "r8", 0), ("gpcc", "r8", 1024)],
)
@pytest.mark.parametrize("far", [0, 500_000_000])
def test_a_file_in_millimetres_comes_back_in_millimetres(
    codec: str, rate: str, size: int, far: int
) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.ones(3), [far, far, 0]
    las = _points(header, _steps(250))
    las.write("mm.las")
    words = ("--scale", size, "--metres-per-unit", 0.001)
    assert _done("prepare", "mm.las", "ready.ply", *words)["metres_per_unit"] == 0.001
    stream = _coded(Path("ready.ply"), codec, rate)
    _done("decode", stream, "back.las", "--like", "ready.ply", "--like", "mm.las")
    back = laspy.read("back.las")
    order = np.argsort(back.user_data)
    assert np.array_equal(back.intensity[order], las.intensity)
    assert np.abs(back.xyz[order] - las.xyz).max() <= (0 if rate == "1mm" else 6)
    assert back.header.offsets.tolist() == [far, far, 0]


@pytest.mark.parametrize("unit", [0.3048, 1200 / 3937])
def test_a_unit_that_is_named_counts_more_than_that_of_the_file(unit: float) -> None:
    steps = _steps(50, 100_000)
    Path("feet.las").write_bytes(las_bytes(steps.tolist(), [geo_keys((3072, 32767), (3076, 9036))]))
    _done("prepare", "feet.las", "ready.ply", "--scale", 0, "--metres-per-unit", unit)
    stream = _coded(Path("ready.ply"), "laz", "1mm")
    _done("decode", stream, "back.las", "--like", "ready.ply", "--like", "feet.las")
    las = laspy.read("back.las")
    assert np.array_equal(np.column_stack([las.X, las.Y, las.Z]), steps)


def test_a_cloud_of_another_unit_or_scale_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 0.01)
    _points(header, _steps(most=200_000)).write("site.las")
    _points(header, _steps(most=200)).write("thousandth.las")
    _done("prepare", "site.las", "ready.ply")
    _done("prepare", "thousandth.las", "small.ply", "--scale", 0)
    for stream, like, fault in (
        ("ready.ply", ["site.las"], "coded.bin: not coded from site.las, unless from a prepared"),
        ("small.ply", ["site.las"], "unless from a prepared cloud (--like it too): the decoded"),
        ("small.ply", ["small.ply", "site.las"], "small.ply: its points are not those of site.las"),
        ("ready.ply", ["small.ply"], "coded.bin: not coded from small.ply: the decoded points lie"),
    ):
        _coded(Path(stream), "draco", "r8")
        capsys.readouterr()
        words = [word for path in like for word in ("--like", path)]
        assert main(["decode", "coded.bin", "back.las", *words]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert fault in line
        assert not Path("back.las").exists()


@pytest.mark.parametrize(("codec", "rate"), [("draco", "2mm"), ("laz", "1mm"), ("gpcc", "10mm")])
def test_points_of_a_wide_file_keep_their_attributes(codec: str, rate: str) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, 0.01), [500_000, 5e6, 0]
    las = _points(header, np.random.default_rng(0).integers(0, 1_500_000, (5000, 3)))
    las.gps_time = np.arange(5000)
    las.write("wide.las")
    row = _done("decode", _coded(Path("wide.las"), codec, rate), "back.las", "--like", "wide.las")
    assert (row["attributes_lost"], row["attributes_unknown"]) == (0, 0)
    back = laspy.read("back.las")
    assert back.points.array[np.argsort(back.gps_time)].tobytes() == las.points.array.tobytes()


@pytest.mark.parametrize("factor", [1, 257, 256])
@pytest.mark.parametrize("codes", [False, True])
def test_colours_of_16_bits_come_back_with_16_bits(factor: int, codes: bool) -> None:
    header = laspy.LasHeader(point_format=2, version="1.2")
    las = _points(header, _steps())
    if factor > 1:
        for name in ("red", "green", "blue"):
            las[name] = (las[name] >> 8) * factor
    las.write("site.las")
    entry = ("--entry", '{"options": {"attributes": true}}') if codes else ()
    stream = _coded(Path("site.las"), "gpcc", "1mm", *entry)
    for like, out in (("site.las", "back.ply"), ("back.ply", "again.ply")):
        _done("decode", stream, out, "--like", like)
        back = read_ply(Path(out))
        order = np.argsort(back["user_data"])
        assert not {"red_16", "red_"} & set(back)
        for name in ("red", "green", "blue"):
            assert back[name].dtype == np.uint16
            assert np.array_equal(back[name][order], las[name])


def _record(content: bytes) -> bytes:
    return struct.pack("<H16sHQ32s", 0, b"LASF_Spec", 65535, len(content), b"") + content


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_waveforms_behind_the_points_come_back(suffix: str) -> None:
    header = laspy.LasHeader(point_format=4, version="1.3")
    header.global_encoding.waveform_data_packets_internal = True
    las = _points(header, _steps())
    las.write("site.las")
    content = bytearray(Path("site.las").read_bytes())
    struct.pack_into("<Q", content, 227, len(content))
    Path("site.las").write_bytes(content + _record(b"waves" * 20))
    stream = _coded(Path("site.las"), "laz", "1mm")
    _done("decode", stream, f"back.{suffix}", "--like", "site.las")
    back = Path(f"back.{suffix}").read_bytes()
    (offset,) = struct.unpack_from("<Q", back, 227)
    assert back[offset:] == _record(b"waves" * 20)
    assert laspy.read(f"back.{suffix}").points.array.tobytes() == las.points.array.tobytes()


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_waveforms_among_extended_records_come_back(suffix: str) -> None:
    header = laspy.LasHeader(point_format=9, version="1.4")
    las = _points(header, _steps())
    las.evlrs = laspy.vlrs.vlrlist.VLRList(
        [laspy.VLR("first", 1, "", b"x"), laspy.VLR("LASF_Spec", 65535, "", b"waves" * 20)]
    )
    las.write("site.las")
    stream = _coded(Path("site.las"), "laz", "1mm")
    _done("decode", stream, f"back.{suffix}", "--like", "site.las")
    back = Path(f"back.{suffix}").read_bytes()
    (offset,) = struct.unpack_from("<Q", back, 227)
    assert back[offset:].startswith(_record(b"waves" * 20))


def test_the_date_is_kept_and_records_of_copc_chunks_are_not() -> None:
    content = bytearray(las_bytes(_steps().tolist(), [("copc", 1, bytes(160)), ("mine", 7, b"x")]))
    content[90:94] = bytes(4)  # no date
    Path("site.las").write_bytes(content)
    _done("decode", _coded(Path("site.las"), "laz", "1mm"), "back.las", "--like", "site.las")
    assert Path("back.las").read_bytes()[90:94] == bytes(4)
    assert [record.user_id for record in laspy.read("back.las").vlrs] == ["mine"]


def test_external_waveforms_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    header = laspy.LasHeader(point_format=4, version="1.3")
    header.global_encoding.waveform_data_packets_external = True
    _points(header, _steps()).write("site.las")
    stream = _coded(Path("site.las"), "laz", "1mm")
    capsys.readouterr()
    _done("decode", stream, "back.las", "--like", "site.las")
    told = "puckbench: back.las: the waveforms remain in a file (.wdp) beside site.las\n"
    assert capsys.readouterr().err == told


@pytest.mark.parametrize("name", ["back.las.gz", "back.ply.gz", "back.laz.zst", "back.xyz"])
def test_names_of_formats_that_are_not_written_are_refused(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("site.las").write_bytes(las_bytes(_steps().tolist()))
    stream = _coded(Path("site.las"), "laz", "1mm")
    capsys.readouterr()
    assert main(["decode", str(stream), name, "--like", "site.las"]) == 2
    suffix = Path(name).suffix
    known = ".ply, .pcd, .csv, .las, .laz, .bin"
    told = f"puckbench: {name}: {suffix} is not written: name it {known}\n"
    assert capsys.readouterr().err == told
    assert not Path(name).exists()
