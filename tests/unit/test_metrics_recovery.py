"""Recovery of planes, against counts made by hand."""

import numpy as np
import pytest

from puckbench.mesh import Primitive
from puckbench.metrics.recovery import plane_recovery

FLOOR = Primitive("plane", {"normal": [0.0, 0.0, 1.0], "offset": 0.0})
WALL = Primitive("plane", {"normal": [1.0, 0.0, 0.0], "offset": 2.0})
BALL = Primitive("sphere", {"centre": [0.0, 0.0, 1.0], "radius": 0.5})
TRUE = np.repeat([0, 1, 2], [50, 40, 10]).astype(np.int32)


def _recovered(found: np.ndarray, planes: np.ndarray) -> dict[str, float]:
    return plane_recovery(TRUE, (FLOOR, WALL, BALL), found, planes)


def test_what_is_found_exactly_counts_fully() -> None:
    planes = np.array([[0.0, 0, 1, 0], [-1, 0, 0, -2]])
    values = _recovered(np.repeat([0, 1], [50, 50]), planes)
    assert values["precision"] == values["recall"] == values["label_accuracy"] == 1
    assert values["angle_deg"] == values["offset"] == 0


def test_a_plane_split_in_halves_is_not_found() -> None:
    planes = np.array([[0.0, 0, 1, 0], [0, 0, 1, 0.1], [1, 0, 0, 2]])
    values = _recovered(np.repeat([0, 1, 2], [25, 25, 50]), planes)
    assert values["precision"] == pytest.approx(1 / 3)
    assert values["recall"] == 0.5
    assert values["label_accuracy"] == pytest.approx(40 / 90)


def test_differences_of_matched_planes_are_measured() -> None:
    tilt = np.radians(3)
    planes = np.array([[0, -np.sin(tilt), -np.cos(tilt), 0.25], [1, 0, 0, 2.25]])
    values = _recovered(np.repeat([0, 1], [50, 50]), planes)
    assert values["angle_deg"] == pytest.approx(1.5)
    assert values["offset"] == pytest.approx(0.25)
