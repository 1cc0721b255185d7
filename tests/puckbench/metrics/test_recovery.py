"""Recovery of primitives, against counts made by hand."""

from typing import Any

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject
from puckbench.metrics.recovery import (
    Segmentation,
    decoded_in_metres,
    decoded_segmentation,
    recovery,
)

FLOOR = Primitive("plane", {"normal": [0.0, 0.0, 1.0], "offset": 0.0})
WALL = Primitive("plane", {"normal": [1.0, 0.0, 0.0], "offset": 2.0})
BALL = Primitive("sphere", {"centre": [0.0, 0.0, 1.0], "radius": 0.5})
PLANT = Primitive("freeform", {})
POINTS = np.concatenate(
    [
        np.column_stack([np.arange(50.0), np.ones(50), np.zeros(50)]),
        np.column_stack([np.full(40, 2.0), np.arange(40.0), np.ones(40)]),
        np.tile([0.0, 0.5, 1.0], (10, 1)),
    ]
)


def _rows(
    sizes: tuple[int, ...], decoded: tuple[Primitive, ...], last: Primitive = BALL
) -> dict[str, dict[str, Any]]:
    """Recovery by kind of floor (50), wall (40) and `last` (10) from consecutive runs of points."""
    true = Segmentation(np.repeat([0, 1, 2], [50, 40, 10]), (FLOOR, WALL, last))
    made = Segmentation(np.repeat(np.arange(len(sizes)), sizes), decoded)
    return {row["kind"]: row for row in recovery(true, made, POINTS)}


def test_what_is_found_exactly_counts_fully() -> None:
    rows = _rows((50, 40, 10), (FLOOR, WALL, BALL))
    assert list(rows) == ["all", "plane", "sphere"]
    for row in rows.values():
        assert row["precision"] == row["recall"] == row["label_accuracy"] == 1
        assert row["residual_m"] == row["position_m"] == 0
    assert [rows[kind]["matched"] for kind in rows] == [3, 2, 1]
    assert rows["plane"]["angle_deg"] == 0
    assert "radius_m" not in rows["plane"]


def test_a_plane_split_in_halves_is_not_found() -> None:
    row = _rows((25, 25, 40, 10), (FLOOR, FLOOR, WALL, BALL))["plane"]
    assert (row["true"], row["found"], row["matched"]) == (2, 3, 1)
    assert row["precision"] == pytest.approx(1 / 3)
    assert row["recall"] == 0.5
    assert row["label_accuracy"] == pytest.approx(40 / 90)


def test_the_right_points_on_the_wrong_kind_are_not_found() -> None:
    rows = _rows((50, 40, 10), (FLOOR, WALL, FLOOR))
    assert rows["all"]["precision"] == rows["all"]["recall"] == pytest.approx(2 / 3)
    assert rows["all"]["label_accuracy"] == 0.9
    assert rows["sphere"] == {
        "kind": "sphere",
        "true": 1,
        "found": 0,
        "matched": 0,
        "recall": 0,
        "label_accuracy": 0,
    }


def test_what_is_found_on_freeform_surfaces_is_neither_right_nor_wrong() -> None:
    row = _rows((50, 40, 10), (FLOOR, WALL, FLOOR), last=PLANT)["all"]
    assert (row["true"], row["found"]) == (2, 2)
    assert row["precision"] == row["recall"] == row["label_accuracy"] == 1


def test_differences_of_matched_primitives_are_measured() -> None:
    raised = Primitive("plane", {"normal": [0.0, 0.0, -1.0], "offset": -0.25})
    ball = Primitive("sphere", {"centre": [0.0, 0.0, 1.0], "radius": 0.7})
    rows = _rows((50, 40, 10), (raised, WALL, ball))
    assert rows["plane"]["position_m"] == rows["plane"]["residual_m"] == pytest.approx(0.125)
    assert rows["sphere"]["radius_m"] == rows["sphere"]["residual_m"] == pytest.approx(0.2)


def test_points_belong_to_the_segment_whose_surface_is_closest() -> None:
    square = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]])
    vertices = np.concatenate([square, square[:, [0, 2, 1]]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    raised = Primitive("plane", {"normal": [0.0, 0.0, 1.0], "offset": 1e-3})
    front = Primitive("plane", {"normal": [0.0, 1.0, 0.0], "offset": 0.0})
    labels = Labels(
        np.array([1, 1, 0, 0], np.int32),
        np.array([0, 1, 2, 2], np.int32),
        (SceneObject("segment_1", "segment"), SceneObject("segment_2", "segment")),
        (FLOOR, raised, front),
    )
    points = np.array([[1.0, 3, 0.2], [3, 1, 0.2], [2, 0.1, 3]])
    segmentation = decoded_segmentation(Mesh(vertices, triangles), labels, points)
    assert segmentation.numbers.tolist() == [1, 1, 0]
    assert segmentation.primitives[0] == front


def test_a_segments_primitive_has_most_of_its_area() -> None:
    vertices = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [5, 5, 0], [6, 5, 0], [5, 6, 0]])
    labels = Labels(
        np.zeros(2, np.int32), np.array([1, 0], np.int32), (SceneObject("a", "b"),), (WALL, FLOOR)
    )
    mesh = Mesh(vertices, np.array([[0, 1, 2], [3, 4, 5]]))
    assert decoded_segmentation(mesh, labels, vertices).primitives == [FLOOR]


@pytest.mark.parametrize(("points", "counted"), [(1000, 1), (1001, 0)])
def test_a_primitive_counts_with_a_thousandth_of_the_points(points: int, counted: int) -> None:
    numbers = np.repeat([0, 1], [points - 1, 1])
    both = Segmentation(numbers, (FLOOR, BALL))
    rows = {row["kind"]: row for row in recovery(both, both, np.zeros((points, 3)))}
    assert (rows["all"]["true"], rows["all"]["found"]) == (1 + counted, 1 + counted)
    assert ("sphere" in rows) == bool(counted)


@pytest.mark.parametrize(("shared", "matched"), [(50, 0), (51, 1), (55, 1)])
def test_a_match_shares_more_than_half_of_the_points_that_either_has(
    shared: int, matched: int
) -> None:
    """100 points on a wall, of which some are found with it; the others are found on nothing."""
    true = Segmentation(np.zeros(100, np.int64), (WALL,))
    made = Segmentation(np.repeat([0, 1], [shared, 100 - shared]), (WALL, PLANT))
    (row, *_) = recovery(true, made, np.zeros((100, 3)))
    assert row["matched"] == matched
    assert row["label_accuracy"] == matched * shared / 100


@pytest.mark.parametrize(("freeform", "counted"), [(5, 1), (6, 0)])
def test_what_is_found_mostly_on_freeform_surfaces_does_not_count(
    freeform: int, counted: int
) -> None:
    true = Segmentation(np.repeat([0, 1], [20 - freeform, freeform]), (FLOOR, PLANT))
    made = Segmentation(np.repeat([0, 1], [10, 10]), (FLOOR, WALL))
    (row, *_) = recovery(true, made, np.zeros((20, 3)))
    assert row["found"] == 1 + counted


def test_a_decoded_surface_is_compared_in_metres() -> None:
    """Of a cube of 100 units per metre whose corner is at (1, 2, 3) m; or as it is."""
    vertices = np.array([[0.0, 0, 50], [400, 0, 50], [0, 400, 50]])
    plane = Primitive("plane", {"normal": [0.0, 0.0, 1.0], "offset": 50.0})
    labels = Labels(
        np.zeros(1, np.int32), np.zeros(1, np.int32), (SceneObject("a", "b"),), (plane,)
    )
    mesh = Mesh(vertices, np.array([[0, 1, 2]]), labels)
    about = {"scale": 100.0, "offset": [1.0, 2.0, 3.0]}
    segmentation = decoded_in_metres(mesh, PointCloud(vertices, about=about))
    assert segmentation.numbers.tolist() == [0, 0, 0]
    assert segmentation.primitives[0].parameters["offset"] == pytest.approx(3.5)
    unscaled = decoded_in_metres(mesh, PointCloud(vertices))
    assert unscaled.primitives[0].parameters["offset"] == 50
