"""Decoded clouds in the formats of other tools, with what the stream tells of each point."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from cloud_files.las import read_las
from cloud_files.pcd import read_pcd
from cloud_files.text import read_csv
from puckbench.cli import main
from tests.puckbench.cli.test_round_trips import _coded, _done
from tests.support.spinning import pcap, rows, spin

ALL = '{"options": {"times": true, "reflectivities": true}}'


@pytest.fixture(autouse=True)
def turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, np.ndarray]:
    """A turn as `export` writes it to turn.pcd, and as a prepared cloud with returns, turn.ply."""
    monkeypatch.chdir(tmp_path)
    Path("drive.pcap").write_bytes(pcap(rows(spin(packets=400, rise=40))))
    _done("prepare", "drive.pcap", "turn.ply", "--turns", "1")
    _done("export", "drive.pcap", "turn.pcd", "--turns", "1")
    return read_pcd(Path("turn.pcd"))


@pytest.mark.parametrize("like", [(), ("--like", "turn.ply")])
def test_a_stream_of_returns_gives_ring_time_and_intensity(
    turn: dict[str, np.ndarray], like: tuple[str, ...]
) -> None:
    stream = _coded(Path("turn.ply"), "puck", "2mm", "--entry", ALL)
    for suffix in ("ply", "pcd", "csv", "las", "laz", "bin"):
        _done("decode", stream, f"back.{suffix}", *like)
    for columns in (read_pcd(Path("back.pcd")), read_csv(Path("back.csv"))):
        assert {*columns} == {*turn}
        for name, values in turn.items():
            assert columns[name] == pytest.approx(values, abs=1e-6), name
    names = {"laser_id": "ring", "reflectivity": "intensity", "timestamp": "time"}
    for suffix in ("las", "laz"):
        columns = read_las(Path(f"back.{suffix}"))
        for name, other in names.items():
            assert columns[name] == pytest.approx(turn[other], abs=1e-6)
    assert read_cloud("back.ply").fields["ring"].tolist() == turn["ring"].tolist()
    intensity = read_cloud("back.bin", bin_columns="4").fields["intensity"]
    assert intensity == pytest.approx(turn["intensity"] / 255, abs=1e-6)


def test_a_stream_without_times_and_reflectivities_gives_rings(
    turn: dict[str, np.ndarray],
) -> None:
    _done("decode", _coded(Path("turn.ply"), "puck", "2mm"), "back.pcd")
    columns = read_pcd(Path("back.pcd"))
    assert [*columns] == ["x", "y", "z", "ring"]
    assert columns["ring"].tolist() == turn["ring"].tolist()


def test_what_the_original_lacks_comes_from_the_stream(turn: dict[str, np.ndarray]) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 1e-4)
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(turn["x"]), header=header))
    las.x, las.y, las.z = turn["x"], turn["y"], turn["z"]
    las.classification[:] = 7
    las.write("turn.las")
    stream = _coded(Path("turn.ply"), "puck", "2mm", "--entry", ALL)
    _done("decode", stream, "back.las", "--like", "turn.las")
    _done("decode", stream, "back.pcd", "--like", "turn.las")
    of_las, of_pcd = laspy.read("back.las"), read_pcd(Path("back.pcd"))
    for columns, ring, time in ((of_las, "user_data", "gps_time"), (of_pcd, "ring", "time")):
        assert np.array_equal(columns[ring], turn["ring"])
        assert np.asarray(columns[time]) == pytest.approx(turn["time"], abs=1e-6)
        assert np.array_equal(columns["intensity"], turn["intensity"])
        assert set(np.asarray(columns["classification"])) == {7}


def test_decoded_intensities_and_colours_replace_those_of_a_las_file() -> None:
    header = laspy.LasHeader(point_format=2, version="1.2")
    header.scales = np.full(3, 1e-3)
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(60, header=header))
    las.X, las.Y, las.Z = np.random.default_rng(0).integers(0, 10_000, (3, 60))
    las.intensity = np.arange(60) * 100
    for name in ("red", "green", "blue"):
        las[name] = np.arange(60) * 1000 + 1
    las.write("site.las")
    stream = _coded(Path("site.las"), "gpcc", "1mm", "--entry", '{"options": {"attributes": true}}')
    las.intensity = np.zeros(60)
    las.write("dark.las")
    _done("decode", stream, "back.las", "--like", "dark.las")
    back = laspy.read("back.las")
    order = np.argsort(back.intensity)
    assert back.intensity[order].tolist() == (np.arange(60) * 100).tolist()
    assert back.red[order].tolist() == (np.arange(60) * 1000 + 1).tolist()
    _done("decode", stream, "alone.las")  # 8 bits are coded
    assert np.sort(laspy.read("alone.las").red).tolist() == sorted(
        (np.arange(60) * 1000 + 1 >> 8) * 257
    )


def test_the_name_of_a_copc_file_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "turn.pcd", "out.copc.laz"]) == 2
    error = capsys.readouterr().err
    assert error == "puckbench: out.copc.laz: COPC files are not written: name it .laz\n"
    assert not Path("out.copc.laz").exists()
