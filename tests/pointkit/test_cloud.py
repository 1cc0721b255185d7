"""What a cloud takes, and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud, UncheckedCloud

POINTS = np.array([(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)])
NAN = np.array([(1.0, 2.0, 3.0), (4.0, np.nan, 6.0)])


@pytest.mark.parametrize(
    ("points", "fault"),
    [
        (NAN, "1 of 2 points are not finite"),
        (NAN * np.inf, "2 of 2 points are not finite"),
        (np.zeros((3, 4)), r"expected points of shape \(n, 3\), got \(3, 4\)"),
        (POINTS.ravel(), r"got \(6,\)"),
        ([[1, 2, 3], [4, 5]], "points: not an array"),
        ("cloud.ply", "points: not numbers, but str"),
        (None, "points: not numbers, but NoneType"),
        (POINTS > 3, "points: not numbers, but an array of bool"),
        (POINTS.astype(object), "points: not numbers, but an array of object"),
        (POINTS + 1j, "points: not numbers, but an array of complex128"),
    ],
)
def test_other_points_are_refused(points: Any, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        PointCloud(points)


@pytest.mark.parametrize(
    ("attributes", "fault"),
    [
        ({"normals": POINTS[:1]}, r"expected normals of shape \(2, 3\), got \(1, 3\)"),
        ({"colours": POINTS / 10}, "colours: not whole numbers from 0 to 255"),
        ({"colours": POINTS + 255}, "colours: not whole numbers from 0 to 255"),
        ({"colours": -POINTS}, "colours: not whole numbers from 0 to 255"),
        ({"labels": [0.5, 1]}, "labels: not whole numbers"),
        ({"labels": [2**40, 1]}, "labels: not whole numbers"),
        ({"labels": [[1], [2]]}, r"expected labels of shape \(2,\), got \(2, 1\)"),
        ({"fields": {"a": [1, 2, 3]}}, "field a: expected a number for each of 2 points"),
        ({"fields": {"a": ["x", "y"]}}, "field a: expected a number for each of 2 points"),
        ({"fields": None}, "fields: not arrays by name, but NoneType"),
        ({"about": ["size"]}, "the cloud's description: not a dict, but list"),
    ],
)
def test_other_attributes_are_refused(attributes: dict[str, Any], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        PointCloud(POINTS, **attributes)


def test_lists_and_whole_numbers_become_the_arrays_that_a_cloud_has() -> None:
    lists: dict[str, Any] = {
        "colours": [[0, 1, 255]] * 2,
        "labels": [7.0, 8],
        "fields": {"a": [1, 2]},
    }
    whole: Any = POINTS.astype(int).tolist()
    cloud = PointCloud(whole, **lists)
    assert cloud.colours is not None
    assert cloud.labels is not None
    kinds = [cloud.xyz.dtype, cloud.colours.dtype, cloud.labels.dtype]
    assert kinds == [np.float64, np.uint8, np.int32]
    assert cloud.fields["a"].tolist() == [1, 2]
    assert len(PointCloud(np.empty((0, 3)))) == 0


def test_a_cloud_of_a_file_may_have_points_that_are_not_finite_until_it_is_checked() -> None:
    cloud = UncheckedCloud(NAN, fields={"a": np.arange(2)})
    with pytest.raises(InputError, match="1 of 2 points are not finite"):
        cloud.checked()
    checked = cloud.select(np.array([0])).checked()
    assert type(checked) is PointCloud
    assert checked.fields["a"].tolist() == [0]
