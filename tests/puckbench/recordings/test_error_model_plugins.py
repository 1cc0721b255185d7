"""Error models from outside of the tree: a user's file, another package, and their faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cloud_files.meshes import write_mesh
from pointkit.registry import trust
from puckbench.cli import main
from puckbench.steps.fingerprints import code_version
from tests.support.sensor_scenes import room
from virtual_lidar import open_error_model, read_scan
from virtual_lidar.errors import module_of_model

SOURCE = '''"""A sensor that reads too far."""

from pydantic import PositiveFloat

from virtual_lidar.errors import ErrorModel


class TooFar(ErrorModel):
    """Every range is a share too long."""

    title, colour = "Too far", "#123456"

    share: PositiveFloat = 0.01

    def perturb_ranges(self, hits, sensor, draws):
        """True distance, lengthened."""
        return hits.distance * (1 + self.share)
'''


@pytest.fixture
def place(tmp_path: Path) -> str:
    (tmp_path / "far.py").write_text(SOURCE)
    trust([named := f"{tmp_path / 'far.py'}:TooFar"])
    return named


def test_a_scan_takes_the_error_model_of_a_users_file(tmp_path: Path, place: str) -> None:
    write_mesh(tmp_path / "room.ply", replace(room(), labels=None))
    words = ["scan", str(tmp_path / "room.ply"), str(tmp_path / "a.parquet"), "--origin"]
    words += ["2", "2", "1", "--sweep", '{"preset": "spin", "azimuth_step_deg": 4}']
    words += ["--errors", place, "--error-options", '{"share": 0.5}']
    assert main(words) == 0
    table = read_scan(tmp_path / "a.parquet")
    assert np.allclose(table["distance_noisy"], 1.5 * table["distance"])
    assert table.about["errors"] == {"model": "TooFar", "share": 0.5}


def test_a_users_model_is_fingerprinted_by_its_file(tmp_path: Path, place: str) -> None:
    model = open_error_model(place)
    before = code_version(module_of_model(model))
    (tmp_path / "other.py").write_text(SOURCE.replace("1 + self", "2 + self"))
    trust([another := f"{tmp_path / 'other.py'}:TooFar"])
    other = open_error_model(another)
    assert code_version() != before != code_version(module_of_model(other))
    assert str(model) == "TooFar(share=0.01)"
