"""What E57 files have besides coordinates (these are in tests/cloud_files/corpus/e57.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from cloud_files.e57 import read_e57

pytest.importorskip("pye57", reason="the test tools have pye57 for Linux on x86-64 alone")

from tests.cloud_files.corpus.e57 import colours, invalid, rich, two_scans


def test_normals_and_colours_are_those_of_the_cloud(tmp_path: Path) -> None:
    rich(tmp_path / "a.e57")
    cloud = read_cloud(tmp_path / "a.e57")
    assert cloud.normals == pytest.approx(np.array([(0, 1, 0), (0, 1, 0)]))  # a quarter turn of x
    assert cloud.colours is not None
    assert cloud.colours.tolist() == [[0] * 3, [255] * 3]
    assert cloud.fields["isColorInvalid"].dtype.kind == "i"
    assert "scan" not in cloud.fields


def test_invalid_points_have_no_coordinates(tmp_path: Path) -> None:
    invalid(tmp_path / "a.e57")
    columns = read_e57(tmp_path / "a.e57")
    xyz = np.column_stack([columns[axis] for axis in "xyz"])
    assert np.isnan(xyz).all(axis=1).tolist() == [False, True, False]
    assert "cartesianInvalidState" not in columns


def test_scans_are_numbered(tmp_path: Path) -> None:
    two_scans(tmp_path / "a.e57")
    assert list(read_e57(tmp_path / "a.e57")) == ["x", "y", "z", "scan"]


def test_colours_of_8_and_16_bits_become_the_same(tmp_path: Path) -> None:
    colours(tmp_path / "a.e57")
    cloud = read_cloud(tmp_path / "a.e57")
    assert cloud.colours is not None
    assert cloud.colours[:, 0].tolist() == [0, 255, 0, 255]
