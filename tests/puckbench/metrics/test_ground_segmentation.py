"""Ground segmentation of a plane with boxes, whose ground is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.further_metrics.ground_segmentation import (
    ground_truth,
    sensor_height,
    sensor_position,
)
from puckbench.metrics.metric_registry import further_metrics

HEIGHT_M = 2.1
ABOUT = {"size": 0, "classes": ["car", "road"], "label_set": "scene"}
METRIC = "ground_segmentation"


@pytest.fixture(scope="module")
def scene() -> PointCloud:
    """A road with 12 boxes, 3 to 30 m from a sensor that is 2.1 m above the road."""
    pytest.importorskip("pypatchworkpp")
    rng = np.random.default_rng(0)
    far, angle = rng.uniform(3, 30, 12_000), rng.uniform(0, 2 * np.pi, 12_000)
    road = np.column_stack([far * np.cos(angle), far * np.sin(angle), rng.normal(0, 0.01, 12_000)])
    middles = 14 * np.column_stack([np.cos(0.5 * np.arange(12)), np.sin(0.5 * np.arange(12))])
    boxes = rng.uniform(-1, 1, (4_000, 3)) * (1.2, 1.2, 0.7) + (0, 0, 1.1)
    boxes[:, :2] += middles[rng.integers(0, 12, 4_000)]
    points = np.vstack([road, boxes]) - (0, 0, HEIGHT_M)
    return PointCloud(points, labels=np.repeat([1, 0], [12_000, 4_000]), about=ABOUT)


def test_the_ground_of_a_plane_with_boxes_is_found(scene: PointCloud) -> None:
    values = further_metrics([METRIC], scene, scene, ())
    assert values["ground_iou_percent"] > 97
    assert values["ground_accuracy_percent"] > 97
    for name in ("iou", "accuracy", "agreement"):
        assert values[f"ground_{name}_percent"] == values[f"ground_undecoded_{name}_percent"]
    assert values["ground_agreement_percent"] == 100
    assert values["ground_unanswered_percent"] == 0
    assert values["ground_height_m"] == pytest.approx(HEIGHT_M, abs=0.05)
    assert further_metrics([METRIC], scene, scene, ()) == values


def test_the_program_prints_nothing(scene: PointCloud, capfd: pytest.CaptureFixture[str]) -> None:
    """Its constructor greets on standard output, where a command's answer is."""
    further_metrics([METRIC], scene, scene, ())
    assert capfd.readouterr().out == ""


def test_points_without_a_decoded_point_nearby_are_wrong(scene: PointCloud) -> None:
    left = scene.select(scene.xyz[:, 0] < 0)
    values = further_metrics({METRIC: {"reach_m": 0.5}}, scene, left, ())
    some = scene.xyz[::8]
    unanswered = 100 * np.mean(cdist(some, left.xyz).min(axis=1) > 0.5)
    assert values["ground_unanswered_percent"] == pytest.approx(unanswered, abs=1.5)
    assert values["ground_accuracy_percent"] == pytest.approx(100 - unanswered, abs=3)
    assert values["ground_undecoded_accuracy_percent"] > 97


def test_a_coarse_grid_costs_more_than_a_fine_one(scene: PointCloud) -> None:
    fine, coarse = (
        further_metrics([METRIC], scene, PointCloud(np.round(scene.xyz / step) * step), ())
        for step in (0.02, 0.5)
    )
    assert fine["ground_iou_percent"] > 96
    assert coarse["ground_iou_percent"] < fine["ground_iou_percent"] - 1
    assert coarse["ground_agreement_percent"] < fine["ground_agreement_percent"]


def test_without_classes_only_the_agreement_is_known(scene: PointCloud) -> None:
    plain = replace(scene, labels=None)
    half = scene.select(np.arange(0, len(scene), 2))
    values = further_metrics({METRIC: {"reach_m": 2.0}}, plain, half, ())
    assert values["ground_agreement_percent"] > 90
    assert "ground_iou_percent" not in values
    scaled = replace(scene, about={"size": 1024})
    assert further_metrics([METRIC], scaled, scaled, ()) == {}


def test_an_option_that_is_no_length_is_refused(scene: PointCloud) -> None:
    with pytest.raises(InputError, match="reach_m and max_range_m must be above 0"):
        further_metrics({METRIC: {"reach_m": 0.0}}, scene, scene, ())
    with pytest.raises(InputError, match=r"metric ground_segmentation: options: .*'reach'"):
        further_metrics({METRIC: {"reach": 0.1}}, scene, scene, ())


def test_points_without_a_class_are_not_judged() -> None:
    points = np.zeros((5, 3))
    about = {"classes": ["unlabeled", "road", "vegetation"], "label_set": "semantickitti"}
    truth = ground_truth(PointCloud(points, labels=[0, 1, 2, -1, 1], about=about))
    assert truth is not None
    np.testing.assert_array_equal(truth[0], [False, True, False, False, True])
    np.testing.assert_array_equal(truth[1][truth[0]], True)
    in_a_scene = PointCloud(points, labels=[0, 1, 2, -1, 1], about={**about, "label_set": "scene"})
    np.testing.assert_array_equal(ground_truth(in_a_scene)[0], [False, True, True, False, True])


def test_the_sensor_is_at_the_origin_of_the_scan() -> None:
    points = np.array([[0.0, 0, 0], [5, 0, -1.5], [0, 5, -1.5], [0, -5, -1.5]])
    assert sensor_height(points[1:]) == pytest.approx(1.5)
    for about, expected in (
        ({}, (0, 0, 0)),
        ({"origin": [1.0, 2.0, 3.0]}, (1, 2, 3)),
        ({"origin": [1.0, 2.0, 3.0], "offset": [1.0, 2.0, 3.0]}, (0, 0, 0)),  # sensor coordinates
    ):
        np.testing.assert_array_equal(sensor_position(PointCloud(points, about=about)), expected)
