"""The network learns what is learnable, and its settings, examples and scores are as stated."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch

from lidar_segmentation import (
    IGNORED,
    LabelledScan,
    SegmentationNetwork,
    confusion,
    ious,
    mean_iou,
    open_network,
)
from lidar_segmentation.network import fused
from lidar_segmentation.training import class_weights, moved
from pointkit.errors import InputError
from tests.lidar_segmentation.toy import FLOOR, SETTINGS, WALL, scan

pytestmark = pytest.mark.usefixtures("one_thread")


@cache
def trained() -> torch.nn.Module:
    model, examples = SETTINGS.module().train(), SETTINGS.examples([scan(1), scan(2)])
    optimiser = torch.optim.Adam(model.parameters(), SETTINGS.learning_rate)
    for step in range(SETTINGS.steps):
        optimiser.zero_grad()
        examples.loss(model, examples.batch(step)).backward()
        optimiser.step()
    return model


@pytest.fixture
def network(tmp_path: Path) -> SegmentationNetwork:
    SETTINGS.export(tmp_path / "toy.safetensors", trained(), {"data": "toy"})
    return open_network(tmp_path / "toy.safetensors")


def test_a_floor_and_a_wall_are_learned(network: SegmentationNetwork) -> None:
    held_out = scan(3)
    predicted = network.predict(held_out.xyz)
    assert mean_iou(confusion(held_out.classes, predicted, len(network.classes))) > 0.95
    assert network.card == {"data": "toy"}
    assert [network.classes[number] for number in (FLOOR, WALL)] == ["floor", "wall"]


def test_the_exported_network_computes_what_the_trained_one_does(
    network: SegmentationNetwork,
) -> None:
    from lidar_segmentation.grid import gridded

    model = trained().eval()
    seen = gridded(scan(3).xyz, model.shape)
    inputs = [torch.from_numpy(each) for each in (seen.columns, seen.places, seen.features)]
    with torch.inference_mode():
        before, after, stored = (
            each(inputs[0][None], inputs[1:2], inputs[2:])
            for each in (model, fused(model), network.module)
        )
    np.testing.assert_allclose(after.numpy(), before.numpy(), atol=1e-3)
    np.testing.assert_allclose(stored.numpy(), before.numpy(), atol=0.1)  # in half precision


def test_a_step_s_examples_depend_on_the_seed_and_the_step_alone() -> None:
    examples = SETTINGS.examples([scan(1), scan(2)])
    one, again, other = examples.batch(7), examples.batch(7), examples.batch(8)
    assert np.array_equal(one[0].scan.columns, again[0].scan.columns)
    assert np.array_equal(one[1].scan.features, again[1].scan.features)
    assert not np.array_equal(one[0].scan.columns, other[0].scan.columns)
    assert one[0].scan.columns.shape == (SETTINGS.bins + 3, 16, 16)
    assert len(one[0].classes) <= SETTINGS.points * 17 // 16


def test_moved_points_keep_their_distances_up_to_the_jitter() -> None:
    xyz, rng = scan(1, 200).xyz, np.random.default_rng(0)
    still = SETTINGS.replaced(jitter_m=0.0)
    for _ in range(4):
        other = moved(xyz, still, rng)
        lengths = [np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (xyz, other)]
        np.testing.assert_allclose(*lengths, atol=1e-4)
        tilt = np.radians(still.tilt_deg) * 2 * np.abs(xyz).max()
        assert np.abs(other[:, 2] - xyz[:, 2]).max() <= still.height_m + tilt


def test_rare_classes_weigh_more() -> None:
    """As the inverse root of their shares; the mean over all points is 1."""
    scans = [LabelledScan(np.zeros((10, 3), np.float32), np.array([0] * 9 + [2], np.uint8))]
    weights = class_weights(scans, 3)
    assert weights[1] == 0
    np.testing.assert_allclose(weights[2] / weights[0], 3, rtol=1e-6)
    np.testing.assert_allclose((9 * weights[0] + weights[2]) / 10, 1, rtol=1e-6)


def test_scores_are_those_of_a_case_worked_out_by_hand() -> None:
    truth = np.array([0, 0, 0, 1, 1, IGNORED], np.uint8)
    predicted = np.array([0, 0, 1, 1, 2, 0], np.uint8)
    matrix = confusion(truth, predicted, 4)
    assert matrix.tolist() == [[2, 1, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    np.testing.assert_allclose(ious(matrix), [2 / 3, 1 / 3, np.nan, np.nan])
    assert mean_iou(matrix) == pytest.approx(0.5)
    assert np.isnan(mean_iou(np.zeros((2, 2), np.int64)))


def test_unusable_scans_end_in_one_line() -> None:
    with pytest.raises(InputError, match=r"^3 labels for points \(2, 3\): one for each is needed$"):
        LabelledScan(np.zeros((2, 3), np.float32), np.zeros(3, np.uint8))
    nothing = LabelledScan(np.zeros((2, 3), np.float32), np.full(2, IGNORED, np.uint8))
    with pytest.raises(InputError, match=r"^no scan has a point with a class of the network$"):
        SETTINGS.examples([nothing])
