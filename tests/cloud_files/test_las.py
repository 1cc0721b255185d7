"""LAS files with a unit given by the caller (others are in tests/cloud_files/corpus/las.py)."""

from __future__ import annotations

from pathlib import Path

import pytest

from cloud_files.las import read_las_points
from tests.cloud_files.corpus.las import POINTS, STEPS, wkt
from tests.support.las_files import las_bytes


@pytest.mark.parametrize("system", ["EPSG:2225", "EPSG:4326"])
def test_coordinates_are_kept_without_conversion(
    system: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "a.las").write_bytes(las_bytes(STEPS, [wkt(system)]))
    columns = read_las_points(tmp_path / "a.las", convert=False)
    assert columns["z"].tolist() == POINTS[:, 2].tolist()
    assert not caplog.records
