"""The unit that a user names counts more than that of a LAS file's reference system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from puckbench.cli import main
from puckbench.scene_sets.point_clouds import PointClouds
from tests.cloud_files.corpus.las import POINTS, STEPS, US_FOOT, wkt
from tests.support.las_files import las_bytes


@pytest.mark.parametrize(("unit", "scale"), [(1.0, US_FOOT), (0.001, 0.001)])
def test_one_unit_is_applied(unit: float, scale: float, tmp_path: Path) -> None:
    path = tmp_path / "a.las"
    path.write_bytes(las_bytes(STEPS, [wkt("EPSG:2225")]))
    scene = PointClouds(path=str(path), metres_per_unit=unit).load("a")
    assert scene.cloud is not None
    np.testing.assert_allclose(scene.cloud.xyz, POINTS * scale, rtol=0, atol=1e-12)
    words = ["prepare", str(path), str(tmp_path / "b.ply"), "--scale", "0"]
    assert main([*words, "--metres-per-unit", str(unit)]) == 0
    prepared = read_cloud(tmp_path / "b.ply").xyz
    np.testing.assert_allclose(np.ptp(prepared, axis=0), np.ptp(POINTS, axis=0) * scale, atol=1e-12)
