"""3D-MiniNet: published sizes, the range image and the vote against independent computations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from lidar_segmentation import open_network
from lidar_segmentation.mininet import (
    CLASSES,
    PARTS,
    MiniNet,
    network_input,
    open_mininet,
    range_image,
)
from lidar_segmentation.mininet_module import MiniNetModule
from pointkit.errors import InputError

PUBLISHED_PARAMETERS = 445_431
"""Parameters of 3D-MiniNet-tiny (github.com/Shathe/3D-MiniNet): 7 and 5 blocks of the encoder."""


def tiny() -> MiniNetModule:
    torch.manual_seed(0)
    return MiniNetModule(width=96, blocks=(7, 5), back=(2, 1), classes=20)


def small() -> MiniNetModule:
    torch.manual_seed(0)
    return MiniNetModule(width=16, blocks=(1, 2), back=(2, 1), classes=20).eval()


def save(folder: Path, module: MiniNetModule) -> None:
    for part, name in PARTS.items():
        torch.save(module.get_submodule(part).state_dict(), folder / name)


def scan(count: int = 3000) -> np.ndarray:
    """Points of all directions in the field of view, x right, y forward."""
    random = np.random.default_rng(5)
    turned, raised = random.uniform(-np.pi, np.pi, count), np.radians(random.uniform(-24, 2, count))
    away = random.uniform(3, 60, count)
    level = away * np.cos(raised)
    return np.column_stack([level * np.sin(turned), level * np.cos(turned), away * np.sin(raised)])


def test_the_tiny_network_has_as_many_parameters_as_published() -> None:
    assert sum(each.numel() for each in tiny().parameters()) == PUBLISHED_PARAMETERS


def test_a_pixel_has_the_nearest_point_and_rows_go_down() -> None:
    up, down = np.radians(2.9), np.radians(-24.9)
    rays = [(10.0, up), (20.0, up), (10.0, down)]
    far = [(0.1, 0, 0), *((d * np.cos(e), 0, d * np.sin(e)) for d, e in rays)]
    image = range_image(np.array(far, np.float32), np.zeros(4, np.float32), columns=64)
    assert image.row.tolist()[1:] == [0, 0, 63]
    assert image.column.tolist() == [32] * 4  # straight ahead is the middle
    assert image.channels[0, 0, 32] == pytest.approx(10)
    assert image.mask.sum() == 2  # the pixel of the first point counts as empty, as published
    beside = range_image(np.array([[9, 9, 9], [0, 5, 0]], np.float32), np.zeros(2, np.float32), 64)
    assert beside.column[1] == 16  # the left is a quarter of the image


def test_windows_are_those_of_torch_and_relative_to_the_mean_of_their_points() -> None:
    points = scan()[:, [1, 0, 2]].astype(np.float32)
    image = range_image(points, np.full(len(points), 0.3, np.float32), columns=128)
    normalised, windows = network_input(image)
    unfolded = functional.unfold(torch.from_numpy(normalised)[:, None], 4, stride=4)
    np.testing.assert_array_equal(windows[:5], unfolded.numpy())
    place = int(np.argmax((windows[10] > 0).sum(axis=0)))
    row, column = 4 * (place // 32), 4 * (place % 32)
    part = image.channels[:, row : row + 4, column : column + 4]
    there = image.mask[row : row + 4, column : column + 4]
    mean = part[:, there].mean(axis=1)
    relative = windows[5:10, :, place].reshape(5, 4, 4)[:, there]
    np.testing.assert_allclose(relative, part[:, there] - mean[:, None], atol=1e-5)
    assert (windows[5:, ~there.ravel(), place] == 0).all()


def test_a_point_gets_the_class_of_most_near_pixels() -> None:
    """The head's bias alone decides, so that every pixel, and so every point, has one class."""
    module = small()
    with torch.no_grad():
        for parameter in module.head.parameters():
            parameter.zero_()
        module.head[0].bias[14] = 1.0  # fence: 0 is unlabelled
    network = MiniNet("", module, columns=256)
    assert set(network.predict(scan()).tolist()) == {CLASSES.index("fence")}
    with torch.no_grad():
        module.head[0].bias[0] = 2.0
    assert set(network.predict(scan(200)).tolist()) == {0}  # as published: unlabelled does not vote


def test_weights_in_a_folder_decide_the_numbers_of_blocks(tmp_path: Path) -> None:
    save(tmp_path, small())
    network = open_network(tmp_path)
    assert network.classes == CLASSES
    assert len(network.digest) == 16
    points = scan(500)
    expected = MiniNet("", small()).predict(points)
    np.testing.assert_array_equal(network.predict(points), expected)
    assert network.predict(points[:0]).shape == (0,)


def test_labels_are_the_classes_of_the_benchmark() -> None:
    kitti = MiniNet("", small()).class_map("semantickitti")
    found = kitti.of(["moving-car", "lane-marking", "other-object", "trunk"]).tolist()
    assert found == [CLASSES.index("car"), CLASSES.index("road"), 255, CLASSES.index("trunk")]
    with pytest.raises(InputError, match="labels rooms have no classes of 3D-MiniNet"):
        MiniNet("", small()).class_map("rooms")


def test_other_weights_are_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="backbone: no such file; the weights of 3D-MiniNet are"):
        open_mininet(tmp_path)
    save(tmp_path, small())
    (tmp_path / "segmentation_head").write_bytes(b"damaged")
    with pytest.raises(InputError, match="segmentation_head: damaged weights"):
        open_mininet(tmp_path)
    torch.save({"0.weight": torch.full((20, 8, 3, 3), torch.nan)}, tmp_path / "segmentation_head")
    with pytest.raises(InputError, match="segmentation_head: damaged weights"):
        open_mininet(tmp_path)
    other = MiniNetModule(width=32, blocks=(1, 2), back=(2, 1), classes=20)
    torch.save(other.head.state_dict(), tmp_path / "segmentation_head")
    with pytest.raises(InputError, match="weights of another network than 3D-MiniNet"):
        open_mininet(tmp_path)
    torch.save(torch.nn.Linear, tmp_path / "backbone")  # code, which is not loaded
    with pytest.raises(InputError, match="backbone: damaged weights"):
        open_mininet(tmp_path)


def test_scans_of_another_form_are_refused() -> None:
    network = MiniNet("", small())
    with pytest.raises(InputError, match=r"must be numbers \(n, 3\)"):
        network.predict(np.zeros((4, 2)))
    with pytest.raises(InputError, match="not finite"):
        network.predict(np.full((4, 3), np.nan))
