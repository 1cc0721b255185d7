"""`prepare`, `encode` and `evaluate` take clouds of other formats than their own PLY."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from puckbench.cli import main
from puckbench.io.clouds import read_cloud

STEP = 0.25
POINTS = np.random.default_rng(3).integers(0, 4000, (400, 3)) * STEP
"""Multiples of a step that all formats keep without loss."""


def write_las(path: Path) -> None:
    import laspy

    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, STEP)
    las = laspy.LasData(header)
    las.x, las.y, las.z = POINTS.T
    las.write(path)


WRITERS: dict[str, Callable[[Path], None]] = {
    "las": write_las,
    "npy": lambda path: np.save(path, POINTS),
    "xyz": lambda path: np.savetxt(path, POINTS, fmt="%.2f"),
}


@pytest.fixture(params=WRITERS)
def cloud(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"cloud.{request.param}"
    WRITERS[request.param](path)
    return path


def answer(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    capsys.readouterr()
    assert main([*map(str, words), "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_prepare_scales_it_to_the_cube(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer(capsys, "prepare", cloud, tmp_path / "out.ply")
    prepared = read_cloud(tmp_path / "out.ply")
    assert prepared.normals is not None
    low, size = POINTS.min(axis=0), np.ptp(POINTS, axis=0).max()
    expected = (POINTS - low) * 1023 / size
    assert sorted(map(tuple, prepared.xyz.round(6))) == sorted(map(tuple, expected.round(6)))


def test_encode_and_evaluate_take_it_as_it_is(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream = tmp_path / "cloud.bin"
    record = answer(capsys, "encode", cloud, stream, "--codec", "draco", "--rate", "r4")
    assert record["points_in"] == len(POINTS)
    np.save(tmp_path / "moved.npy", POINTS + np.array((0.0, 0.0, 0.125)))
    row = answer(capsys, "evaluate", cloud, tmp_path / "moved.npy")
    # No other point is as near as the one that was moved by half a step.
    assert row["d1_mse"] == pytest.approx(0.125**2)
    assert row["points_a"] == len(POINTS)
    row = answer(capsys, "evaluate", cloud, stream)
    assert 0 < row["d1_mse"] < 100
