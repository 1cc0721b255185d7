import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cloud_files.meshes import write_mesh
from puckbench.cli import main
from tests.support.sensor_scenes import room
from virtual_lidar import (
    COLUMNS,
    read_scan,
)

ROWS = "0, 0, 0, 0, 0, 0, 0\n2, 1, 0, 0, 45, 0, 0\n"


def test_a_long_scan_by_hand_goes_to_disk_in_portions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same rows, whether the command holds them all in memory or not."""
    way, mesh = tmp_path / "way.csv", tmp_path / "room.ply"
    way.write_text(ROWS)
    write_mesh(mesh, replace(room(), labels=None))
    sweep = json.dumps({"trajectory": str(way), "duration_s": 0.3, "azimuth_step_deg": 1})
    words = ["scan", str(mesh), "--errors", "vlp16", "--sweep", sweep, "--origin", "2", "2", "1"]
    assert main([*words[:2], str(tmp_path / "whole.parquet"), *words[2:]]) == 0
    monkeypatch.setattr("puckbench.steps.scan._RAYS_IN_MEMORY", 1000)
    assert main([*words[:2], str(tmp_path / "streamed.parquet"), *words[2:]]) == 0
    whole, streamed = (read_scan(tmp_path / f"{name}.parquet") for name in ("whole", "streamed"))
    assert len(whole) == 36 * 15 * 16
    assert all(np.array_equal(whole[name], streamed[name]) for name in COLUMNS)
