"""Segmentation of decoded scans, against counts by hand and against a network known beforehand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pointkit.confusion import IGNORED, Counts, class_ious, confusion
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.geometry.labels import OF_SCENE, described_classes
from puckbench.metrics.metric_registry import further_metrics
from puckbench.metrics.segmentation import (
    Classes,
    JudgedScan,
    Rows,
    accuracy_percent,
    confusion_of,
    kept_points,
    mean_iou_percent,
)

LINE = np.column_stack([np.arange(8.0), np.zeros(8), np.zeros(8)])
"""Points 1 m apart; the network below calls those with x of at least 4 the class 1."""
TRUE = np.array([0, 0, 0, 0, 1, 1, 1, 1], np.uint8)


def by_place(points: Floats, _: Rows) -> Classes:
    return (points[:, 0] >= 4).astype(np.uint8)


def judged(decoded: Floats, true: Classes = TRUE) -> dict[str, Counts]:
    scan = JudgedScan(LINE, true, ("low", "high"), by_place, 0.5)
    return {"undecoded_": scan.undecoded(), **dict(scan.decoded(decoded))}


def test_iou_and_accuracy_are_those_of_counts_by_hand() -> None:
    counts = confusion(np.array([0, 0, 1, 1, 1, 3, IGNORED]), np.array([0, 1, 1, -1, 1, 0, 2]), 4)
    assert counts.tolist() == [[1, 1, 0, 0, 0], [0, 2, 0, 0, 1], [0, 0, 0, 0, 0], [1, 0, 0, 0, 0]]
    np.testing.assert_allclose(class_ious(counts), [1 / 3, 1 / 2, np.nan, 0])
    assert mean_iou_percent(counts) == pytest.approx(100 * (1 / 3 + 1 / 2 + 0) / 3)
    assert accuracy_percent(counts) == pytest.approx(100 * 3 / 6)


def test_a_scan_that_comes_back_is_judged_as_without_coding() -> None:
    counts = judged(LINE[::-1])
    assert all(each.tolist() == [[4, 0, 0], [0, 4, 0]] for each in counts.values())


def test_a_dropped_point_is_wrong_unless_another_answers_for_it() -> None:
    far, near = judged(LINE[1:]), judged(np.vstack([LINE[1:7], [6.7, 0, 0]]))
    assert far[""].tolist() == [[3, 0, 1], [0, 4, 0]]
    assert far["decoded_"].tolist() == [[3, 0, 0], [0, 4, 0]]
    assert far["dropped_"].tolist() == far[""].tolist()
    assert near[""].tolist() == [[3, 0, 1], [0, 4, 0]]  # 6.7 m answers for 7 m


def test_the_control_has_the_same_holes_and_no_displacement() -> None:
    moved = LINE[:6] + np.array([0.4, 0, 0])  # 3.4 m stays low, and 6 m, 7 m are dropped
    moved[3, 0] = 4.4
    counts = judged(moved)
    assert counts[""].tolist() == [[3, 0, 1], [0, 2, 2]]
    assert counts["decoded_"].tolist() == [[3, 0, 0], [0, 3, 0]]  # 4.4 m is nearest to a true 1
    assert counts["dropped_"].tolist() == [[3, 0, 1], [0, 2, 2]]
    assert kept_points(LINE, moved).tolist() == [0, 1, 2, 4, 5]
    assert kept_points(LINE, LINE + 0.6).tolist() == list(range(8))


def test_points_without_a_class_count_neither_way() -> None:
    true = np.array([0, 0, IGNORED, IGNORED, 1, 1, 1, IGNORED], np.uint8)
    assert judged(LINE, true)[""].tolist() == [[2, 0, 0], [0, 3, 0]]


# ---- with networks of lidar_segmentation


def labelled(**about: object) -> PointCloud:
    xyz = np.random.default_rng(3).uniform([-20, -20, -2], [20, 20, 4], (400, 3))
    described = {"size": 0, **described_classes(("car", "road"), OF_SCENE), **about}
    return PointCloud(xyz, labels=(xyz[:, 2] < 0).astype(np.int32), about=described)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Random weights of a small network with the classes of streets."""
    import torch

    from lidar_segmentation import class_map
    from lidar_segmentation.network import NetworkShape, SegmentationModule, fused
    from lidar_segmentation.weights_file import write_weights

    torch.manual_seed(1)
    classes = class_map("streets").classes
    shape = NetworkShape(classes=classes, channels=(8, 8, 8, 8), hidden=8, cells=32)
    path = tmp_path_factory.mktemp("weights") / "small.safetensors"
    write_weights(path, shape, fused(SegmentationModule(shape)).state_dict(), {})
    return path


def test_a_network_judges_the_undecoded_scan_and_the_decoded_one_alike(weights: Path) -> None:
    cloud, options = labelled(), {"segmentation": {"network": str(weights)}}
    row = further_metrics(options, cloud, PointCloud(cloud.xyz[::-1]), ())
    assert row["segmentation_miou_percent"] == row["segmentation_undecoded_miou_percent"]
    assert row["segmentation_unanswered_percent"] == 0
    assert row["segmentation_within_m"] == 0.5
    assert confusion_of(row["segmentation_confusion"]).sum() == 400
    empty = further_metrics(options, cloud, PointCloud(cloud.xyz[:1] + 100), ())
    assert empty["segmentation_unanswered_percent"] == 100
    assert empty["segmentation_miou_percent"] == 0


def test_a_network_sees_a_scan_displaced_by_part_of_a_cell() -> None:
    from lidar_segmentation import SegmentationNetwork, open_network
    from puckbench.metrics.further_metrics.segmentation import network_shift

    cell = (0.4, 0.4, 0.3)
    scans = np.arange(2000.0)[:, None, None] * np.ones((4, 3))  # of equal numbers of points
    shifts = np.array([network_shift(points, cell) for points in scans])
    limits = np.array(cell) / 2
    assert (np.abs(shifts) < limits).all()
    np.testing.assert_allclose(shifts.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(
        shifts.std(axis=0), limits / np.sqrt(3), rtol=0.05
    )  # of a uniform one
    np.testing.assert_array_equal(shifts[7], network_shift(scans[7] + 1e-4, cell))

    cloud, network = labelled(), open_network("streets")
    assert isinstance(network, SegmentationNetwork)
    predicted = network.predict(cloud.xyz + network_shift(cloud.xyz, network.cell_m))
    row = further_metrics({"segmentation": {"network": "streets"}}, cloud, cloud, ())
    counts = confusion_of(row["segmentation_confusion"]).sum(axis=0)[:-1]
    assert counts.tolist() == np.bincount(predicted, minlength=len(network.classes)).tolist()


def test_weights_of_mininet_are_not_those_of_the_metric(tmp_path: Path) -> None:
    import torch

    from lidar_segmentation.mininet import PARTS
    from lidar_segmentation.mininet_module import MiniNetModule

    module = MiniNetModule(width=16, blocks=(1, 2), back=(2, 1), classes=20)
    for part, name in PARTS.items():
        torch.save(module.get_submodule(part).state_dict(), tmp_path / name)
    with pytest.raises(InputError, match=r"is of 3D-MiniNet, for the metric mininet"):
        further_metrics({"segmentation": {"network": str(tmp_path)}}, labelled(), labelled(), ())


def test_scans_that_cannot_be_judged_are_refused_in_one_line(weights: Path, tmp_path: Path) -> None:
    good = labelled()
    cases = {
        "no labels of classes": PointCloud(good.xyz, about=good.about),
        "not in metres": labelled(size=1024),
        "no label 'tree'": labelled(**described_classes(("car", "tree"), OF_SCENE)),
        "label 1: the cloud has 1 classes": labelled(**described_classes(("car",), OF_SCENE)),
        "no point of the scan has a class": PointCloud(
            good.xyz,
            labels=np.full(400, -1, np.int32),
            about=good.about,
        ),
        "unknown label set 'cityscapes'": labelled(label_set="cityscapes"),
    }
    for fault, cloud in cases.items():
        with pytest.raises(InputError, match=fault) as error:
            further_metrics({"segmentation": {"network": str(weights)}}, cloud, good, ())
        assert "\n" not in str(error.value)
    (tmp_path / "other").write_bytes(b"no weights")
    with pytest.raises(InputError, match="damaged weights"):
        further_metrics({"segmentation": {"network": str(tmp_path / "other")}}, good, good, ())
    with pytest.raises(InputError, match=r"metric segmentation: options: .*'netwerk'"):
        further_metrics({"segmentation": {"netwerk": "streets"}}, good, good, ())
    with pytest.raises(InputError, match=r"backbone: no such file"):
        further_metrics({"mininet": {"weights": str(tmp_path)}}, good, good, ())
