"""Remarks on results that look wrong, of right codecs at their lowest rates and of wrong ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.registry import open_codec
from puckbench.metrics.cloud_metrics import geometry_metrics
from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud
from puckbench.metrics.remarks import order_remarks, remark_on
from tests.support.codecs import decode, encode


def _room(points: int = 9000, seed: int = 0) -> Floats:
    """Points on a floor, a wall and a sphere, in no order."""
    random = np.random.default_rng(seed)
    a, b = random.random((2, points, 2)) * 1023
    ball = random.normal(size=(points, 3))
    ball = 600 + 200 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    parts = np.stack([np.insert(a, 2, 0.0, axis=1), np.insert(b, 0, 0.0, axis=1), ball])
    return parts[random.integers(0, 3, points), np.arange(points)]


def _cells(points: Floats, step: float) -> Floats:
    return np.unique(np.floor(points / step), axis=0) * step + step / 2


def _remark(points: Floats, decoded: Floats, size: int = 1024) -> str | None:
    reference = ReferenceCloud(PointCloud(points, about={"size": size}))
    distinct = DistinctPoints(decoded)
    return remark_on(reference, distinct, geometry_metrics(reference, distinct))


@pytest.mark.parametrize("codec", ["draco", "gpcc"])
@pytest.mark.parametrize("points", [300, 9000])
def test_a_right_codec_gets_none_at_its_lowest_rate(codec: str, points: int) -> None:
    opened = open_codec(codec)
    original = _room(points)
    decoded = decode(opened, encode(opened, original, next(iter(opened.rates))))
    assert _remark(original, decoded) is None


@pytest.mark.parametrize("step", [1, 16, 128, 512, 2000])
def test_a_grid_of_any_step_gets_none(step: float) -> None:
    """Also where cells' centres are points of a plane, and where one cell holds all points."""
    assert _remark(_room(), _cells(_room(), step)) is None
    plane = np.insert(np.random.default_rng(1).random((9000, 2)) * 1023, 2, step / 2, axis=1)
    assert _remark(plane, _cells(plane, step)) is None


@pytest.mark.parametrize("step", [16, 128])
def test_means_of_cells_get_none(step: float) -> None:
    points = _room()
    cells, of = np.unique(np.floor(points / step), axis=0, return_inverse=True)
    sums = np.stack([np.bincount(of, column, len(cells)) for column in points.T], axis=1)
    assert _remark(points, sums / np.bincount(of)[:, None]) is None


LOST: dict[str, tuple[Callable[[Floats], Floats], str]] = {
    "172 of 9,000": (lambda points: points[:172], "57% of the points are lost"),
    "10 of 9,000": (lambda points: points[:10], "points are lost"),
    "172, rounded": (lambda points: np.rint(points[:172] / 8) * 8, "of the points are lost"),
    "the first in space": (lambda points: points[np.argsort(points[:, 2])[:6000]], "are lost"),
    "the others coarsely": (lambda points: _cells(points[points[:, 2] > 300], 8), "are lost"),
    "the step": (lambda points: np.floor(points / 16), "0.062 times as wide"),
    "the origin": (lambda points: points + np.array([400, 0, 0]), "its step or origin is wrong"),
}


@pytest.mark.parametrize("name", LOST)
def test_a_codec_that_loses_something_gets_one(name: str) -> None:
    decoded, line = LOST[name]
    remark = _remark(_room(), decoded(_room()))
    assert remark is not None
    assert line in remark
    assert len(remark.splitlines()) == 1


def test_points_that_cover_the_cloud_are_not_lost() -> None:
    assert _remark(_room(), _room()[::4]) is None


def test_lengths_have_a_unit_in_metres() -> None:
    remark = _remark(_room() / 100, _room()[:172] / 100, size=0)
    assert remark is not None
    assert remark.endswith(" m")


def test_no_extent_and_no_loss_are_not_odd() -> None:
    one = np.ones((5, 3))
    assert _remark(one, one + 0.1) is None
    assert _remark(_room(), _room()) is None


def _row(rate: str, size: int, error: float) -> dict[str, float | str]:
    return {"rate": rate, "bytes": size, "d1_mse": error**2}


def test_rates_out_of_order_are_named() -> None:
    rows = [_row("r1", 100, 8), _row("r2", 99, 8.1), _row("r3", 200, 14), _row("r4", 150, 1)]
    assert order_remarks(rows) == [
        None,
        None,
        "a larger error than r2: 14 after 8.1",
        "fewer bytes than r3: 150 of 200",
    ]
    assert order_remarks([_row("r1", 9, 0.0), _row("r2", 10, 0.0)]) == [None, None]
    assert order_remarks([]) == []
