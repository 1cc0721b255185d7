"""An option that would have no effect is refused in one line, and nothing is written."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from tests.support.cloud_bags import cloud_bag

CAPTURE = Path(__file__).parents[2] / "data" / "capture" / "single.pcap"
OUT = {"o.ply", "o.json", "o.bin", "o.parquet", "o.safetensors", "out", "o_returns.parquet"}
UNUSED = {
    "prepare t.pcap o.ply --scale grid": "--scale: not with turns, which stay in metres (t.pcap)",
    "prepare t.pcap o.ply --turns 0 --scale grid": "--scale: not with turns",
    "prepare t.pcap o.ply --scale 512": "--scale: not with turns",
    "prepare t.pcap o.ply --crop 0 0 0 1 1 1": "--crop: not with turns, which are whole (t.pcap)",
    "prepare t.pcap o.ply --clean": "--clean: is for scans (t.pcap)",
    "prepare t.pcap o.ply --keep-missing": "--keep-missing: is for clouds, not",
    "prepare a.ply o.ply --clean": "--clean: is for scans (a.ply)",
    "prepare a.ply o.ply --bin-columns 4": "--bin-columns: is for .bin files (a.ply)",
    "prepare a.ply o.ply --topic x": "topic 'x': only ROS bags have topics",
    "encode scaled.ply o.bin --codec gpcc --rate 10mm --frame metric": (
        "scaled.ply: its description says that it is scaled, not metric"
    ),
    "decode a.bin o.ply --rate r5": "a.bin: one stream, not a curve with rates (--rate r5)",
    "decode a.bin o.ply --as-mesh --repeats 3": "--repeats: not with --as-mesh, which is not timed",
    "evaluate a.ply a.ply --codec draco": "--codec: is for streams, and a.ply is a decoded cloud",
    "evaluate a.ply a.ply --repeats 2": "--repeats: is for streams",
    "evaluate a.ply a.ply --rate r1": "--rate: is for streams",
    "evaluate a.ply a.bin --clean a.ply --visible a.ply": "--visible: not with --clean",
    "recovery a.bin a.ply m.off --repeats 2": "--repeats: recovery is not timed",
    "scan m.off o.parquet --origin 0 0 1 --height 2": "--height: not with --origin",
    "scan m.off o.parquet --height 2": "--height: the description of m.off places the sensor",
    "scan m.off o.parquet --error-options {\"x\":1}": "x",
    "train a.ply --out o.safetensors --steps 3 --options {\"steps\":4}": "--steps: --options",
    "train a.ply --out o.safetensors --validate-every 3": "--validate-every: only with --validate",
    "train a.ply --out o.safetensors --peak 3": "--peak: only with --validate",
    "datasets --options {\"count\":3}": "--options: only with --check",
    "residuals o.parquet --capture-options {\"x\":1}": "--capture-options: only with --capture",
    "residuals o.parquet --capture t.pcap --runs 2": "--runs: not with --capture",
    "residuals o.parquet --capture t.pcap --refit": "--refit: not with --capture",
    "run a.ply --out out --scan": "--scan: only for meshes",
    "run a.ply --out out --points 100": "--points: only for meshes",
    "run m.off --out out --scan --points 100": "--points: not with --scan",
    "run a.ply --out out --up y": "--up: only for meshes",
    "run a.ply --out out --bin-columns 4": "--bin-columns: only for .bin files",
    "run m.off --out out --drop-invalid": "--drop-invalid: only for clouds and recorded clouds",
    "run t.pcap --out out --keep-missing": "--keep-missing: only for clouds and recorded clouds",
    "run t.pcap --out out --metres-per-unit 2": "--metres-per-unit: only for clouds and meshes",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    points = np.random.default_rng(0).random((100, 3)) * 100
    write_cloud(Path("a.ply"), PointCloud(points), describe=False)
    write_cloud(Path("scaled.ply"), PointCloud(points, about={"size": 1024}))
    Path("m.off").write_text("OFF\n4 1 0\n-9 -9 0\n9 -9 0\n9 9 0\n-9 9 0\n4 0 1 2 3\n")
    Path("m.json").write_text('{"puckbench": "mesh", "origin": [0, 0, 1]}')
    shutil.copy(CAPTURE, "t.pcap")
    assert main(["encode", "a.ply", "a.bin", "--codec", "draco", "--rate", "r4"]) == 0
    return tmp_path


def _refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert main(words) == 2
    output = capsys.readouterr()
    (line,) = output.err.splitlines()
    assert not output.out
    assert not OUT & {path.name for path in Path().iterdir()}
    return line


@pytest.mark.parametrize("words", UNUSED)
def test_an_option_without_effect_is_refused(
    words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert UNUSED[words] in _refused(words.split(), capsys)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("prepare b.mcap o.ply --scale 512", "--scale: not with clouds of a ROS bag"),
        ("prepare b.mcap o.ply --clean", "--clean: not with clouds of a ROS bag"),
        ("prepare b.mcap o.ply --bin-columns 4", "--bin-columns: not with clouds of a ROS bag"),
        ("export b.mcap o.ply --clean", "--clean: is for scans (b.mcap)"),
    ],
)
def test_clouds_of_a_bag_refuse_options_of_others(
    words: str, told: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud_bag(Path("b.mcap"), {"/points": [np.zeros(3, [(axis, "f4") for axis in "xyz"])]})
    assert told in _refused(words.split(), capsys)
