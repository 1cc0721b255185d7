"""`encode` with a budget of bits: what is written, decoded, told and refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import puckbench
from cloud_files.clouds import read_cloud, write_cloud
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from tests.support.spinning import pcap, rows, spin

TURN_S = 36000 / 160 / 12 * 1327e-6
"""Duration of a turn of `spin`: azimuths rise by 1.6 degrees in each of 12 firings of a packet."""


@pytest.fixture
def cloud(tmp_path: Path) -> Path:
    """A noisy wall of 4 m by 3 m, in metres."""
    random = np.random.default_rng(0)
    points = random.random((4000, 3)) * [4, 3, 0] + random.normal(0, 0.005, (4000, 3))
    write_cloud(tmp_path / "wall.ply", PointCloud(points, about={"size": 0}))
    return tmp_path / "wall.ply"


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    path = tmp_path / "room.pcap"
    path.write_bytes(pcap(rows(spin(packets=140, seed=4))))
    return path


def done(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[dict, str]:
    capsys.readouterr()
    assert main([*map(str, words), "--json"]) == 0
    output = capsys.readouterr()
    return json.loads(output.out), output.err


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main([*map(str, words)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    return output.err


def test_the_stream_that_is_written_takes_the_bits_and_decodes(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, again = cloud.with_suffix(".bin"), cloud.with_name("again.bin")
    row, told = done(capsys, "encode", cloud, out, "--codec", "draco", "--bpp", 6)
    assert told == ""
    assert 0.98 * 6 <= 8 * out.stat().st_size / 4000 == row["bpp"] <= 6
    assert row["budget"] == "6bpp"
    assert json.loads(out.with_name("wall.bin.json").read_text()) == row
    done(capsys, "encode", cloud, again, "--codec", "draco", "--rate", row["rate"])
    assert again.read_bytes() == out.read_bytes()
    done(capsys, "decode", out, cloud.with_name("decoded.ply"))
    assert len(read_cloud(cloud.with_name("decoded.ply"))) > 1000


def test_fixed_rates_and_finest_ones_are_told_in_one_line(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, scaled = cloud.with_suffix(".bin"), cloud.with_name("scaled.ply")
    words = ("encode", cloud, out, "--codec", "draco", "--prepare", scaled, "--frame", "scaled")
    row, told = done(capsys, *words, "--bpp", 5)
    assert row["rate"] in {f"r{number}" for number in range(1, 9)}
    taken = f"{row['bpp']:.4g} bits per point"
    assert told == (
        f"puckbench: codec draco has fixed rates: {row['rate']} takes {taken}, the most within "
        "5bpp\n"
    )
    row, told = done(capsys, *words, "--bpp", 100)
    assert row["rate"] == "r8"
    assert "its finest rate, r8, takes" in told


def test_a_recording_takes_megabits_per_second(
    capture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, other = capture.with_suffix(".bin"), capture.with_name("other.bin")
    coding = ("encode", capture, out, "--codec", "puck")
    lossless, _ = done(capsys, *coding, "--rate", "2mm")
    budget = round(0.7 * 8e-6 * lossless["bytes"] / (6 * TURN_S), 3)
    row, _ = done(capsys, *coding, "--mbps", budget)
    assert row["bytes"] == out.stat().st_size
    assert row["budget"] == f"{budget:g}mbps"
    seconds = 8e-6 * row["bytes"] / row["mbps"]
    assert seconds == pytest.approx(6 * TURN_S, rel=0.01)  # the first and the last turn are cut off
    finer = round(float(row["rate"].removesuffix("mm"))) - 2
    done(capsys, "encode", capture, other, "--codec", "puck", "--rate", f"{finer}mm")
    assert row["mbps"] <= budget < 8e-6 * other.stat().st_size / seconds
    decoded = capture.with_name("decoded.ply")
    done(capsys, "decode", out, decoded)
    assert len(read_cloud(decoded)) == row["points_in"]


def test_the_clouds_of_a_capture_are_those_of_its_whole_turns(
    capture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = capture.with_suffix(".bin")
    row, _ = done(capsys, "encode", capture, out, "--codec", "puck", "--bpp", 6)
    assert row["points_in"] == sum(map(len, puckbench.turns(capture)))
    assert 8 * row["bytes"] / row["points_in"] == row["bpp"] <= 6


FAULTS = {
    "--codec draco --bpp 0.001": "--bpp: codec draco: 0.001bpp is out of reach, which is from ",
    "--codec draco --mbps 3": "--mbps: 3mbps: the time in which the points were recorded is un",
    "--codec draco --bpp 0": "argument --bpp: '0' is not a number above 0",
    "--codec draco --bpp 1 --rate r1": "not allowed with argument",
    "--codec draco": "one of the arguments --rate --bpp --mbps is required",
    "--codec puck --bpp 3": "codes the returns of a spinning sensor, and the cloud has none",
}


@pytest.mark.parametrize("words", FAULTS)
def test_bad_budgets_are_one_line(
    words: str, cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = cloud.with_suffix(".bin")
    assert FAULTS[words] in refused(capsys, "encode", cloud, out, *words.split())
    assert not out.exists()


def test_codecs_of_points_do_not_code_recordings(
    capture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = capture.with_suffix(".bin")
    fault = refused(capsys, "encode", capture, out, "--codec", "draco", "--mbps", 3)
    assert "codes single clouds, not the turns of a recording" in fault
