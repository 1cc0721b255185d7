"""The names that `import puckbench` offers."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import puckbench
from tests.support.cloud_bags import cloud_bag
from tests.support.pages import blocks
from tests.support.spinning import VLP16, pcap, spin


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    path = tmp_path / "turns.pcap"
    path.write_bytes(pcap([bytes(packet) for packet in spin(VLP16, packets=300)]))
    return path


def test_a_capture_goes_turn_by_turn_through_a_codec_and_back(capture: Path) -> None:
    puck = puckbench.open_codec("puck")
    turns = list(puckbench.turns(capture))
    assert len(turns) >= 2
    for turn in turns:
        stream = puck.encode_cloud(turn, "2mm")
        decoded = puck.decode_cloud(stream)
        np.testing.assert_array_equal(decoded.xyz, turn.xyz)
        metrics = puckbench.measures(turn, decoded)
        assert metrics["range_rms_mm"] == metrics["returns_lost"] == metrics["d1_mse"] == 0
        assert metrics["lossless"] == 1


def test_the_loop_of_the_page_prints_bits_and_errors(
    capture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(capture.parent)
    capture.rename("recording.pcap")
    page = "docs/how-to/use_as_a_library.md"
    (code,) = (block for block in blocks(page, "python") if "puckbench.turns" in block)
    exec(code, {})  # noqa: S102 (our own page)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 2
    assert all(float(line.split()[0]) > 0 and float(line.split()[1]) == 0 for line in lines)


def test_turns_of_a_bag_of_clouds_are_the_messages_of_a_topic(tmp_path: Path) -> None:
    clouds = []
    for number in range(3):
        rows = np.zeros(4, [(axis, "<f4") for axis in "xyz"])
        rows["x"] = np.arange(4) + number + 1
        clouds.append(rows)
    bag = cloud_bag(tmp_path / "a.mcap", {"/front": clouds, "/rear": clouds[:1]})
    turns = list(puckbench.turns(bag, topic="/front"))
    assert [turn.xyz[:, 0].tolist() for turn in turns] == [c["x"].tolist() for c in clouds]
    with pytest.raises(puckbench.InputError, match="several topics"):
        next(puckbench.turns(bag))


def test_metrics_of_points_need_no_returns(capture: Path) -> None:
    turn = next(puckbench.turns(capture))
    moved = puckbench.PointCloud(turn.xyz + np.array([0.01, 0, 0]))
    metrics = puckbench.measures(turn, moved)
    assert 0 < metrics["d1_rms_m"] <= 0.01
    assert "range_rms_mm" not in metrics


def test_importing_the_package_imports_nothing_heavy() -> None:
    program = "import sys, puckbench; print(*puckbench.__all__); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    names, modules = map(str.split, done.stdout.splitlines())
    assert {"open_codec", "read_cloud", "turns", "measures"} <= set(names)
    assert not {"numpy", "pandas", "pydantic"} & set(modules)
