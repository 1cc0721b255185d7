"""Labelled scans: SemanticKITTI's files and PCLSegmentation's range images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.geometry.labels import class_labels
from puckbench.scene_sets.labelled_range_images import LabelledRangeImages
from puckbench.scene_sets.semantickitti import SemanticKitti
from tests.support.files import put

FRAME = np.array(
    [[10, -2, 0.5, 0.3], [np.nan, 0, 0, 0], [-4, 3, -1.7, 0.25], [7, 8, 9, 0.5]], dtype="<f4"
)
LABELS = np.array([10, 0, (7 << 16) | 252, 99], dtype="<u4")
"""A car, a point that is not finite, a moving car with number 7, and another object."""


def kitti(root: Path, labels: np.ndarray = LABELS) -> SemanticKitti:
    sequence = root / "sequences" / "08"
    put(sequence / "velodyne" / "000003.bin", FRAME.tobytes())
    put(sequence / "velodyne" / "000004.bin", FRAME.tobytes())  # without labels
    put(sequence / "labels" / "000003.label", labels.tobytes())
    return SemanticKitti(path=str(root))


def test_labels_are_the_lower_half_and_travel_with_their_points(tmp_path: Path) -> None:
    frames = kitti(tmp_path)
    assert frames.names() == ["08_000003"]
    cloud = frames.load("08_000003").cloud
    assert cloud is not None
    numbers, names, label_set = class_labels(cloud)
    assert [names[number] for number in numbers] == ["car", "moving-car", "other-object"]
    assert label_set == "semantickitti"
    expected = [[2, 10, 0.5], [-3, -4, -1.7], [-8, 7, 9]]  # x right, y forward
    np.testing.assert_allclose(cloud.xyz, expected, rtol=1e-6)
    np.testing.assert_allclose(cloud.fields["remission"], [0.3, 0.25, 0.5], rtol=1e-6)
    assert [path.name for path in frames.files("08_000003")] == ["000003.bin", "000003.label"]


@pytest.mark.parametrize(
    ("labels", "fault"),
    [
        (LABELS[:3], r"000003\.label: 3 labels for the 4 points of the frame"),
        (LABELS + 2, r"000003\.label: 12 is none of SemanticKITTI's classes"),
    ],
)
def test_labels_that_do_not_fit_are_refused(tmp_path: Path, labels: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        kitti(tmp_path, labels).load("08_000003")


def test_a_folder_without_labels_has_no_frames(tmp_path: Path) -> None:
    put(tmp_path / "sequences" / "11" / "velodyne" / "000000.bin", FRAME.tobytes())
    with pytest.raises(InputError, match=r"no labelled frames .*semantic-kitti\.org"):
        SemanticKitti(path=str(tmp_path)).names()


def images(root: Path, image: np.ndarray, **options: str) -> LabelledRangeImages:
    folder = root / "val"
    folder.mkdir()
    np.save(folder / "0.npy", image)
    return LabelledRangeImages(path=str(folder), **options)


def image(label: float = 9.0) -> np.ndarray:
    pixels = np.zeros((2, 3, 6))
    pixels[0, 1] = [10, -2, 0.5, 0.3, 10.2, 1]
    pixels[1, 2] = [-4, 3, -1.7, 0.25, 5.3, label]
    return pixels


def test_pixels_without_depth_are_no_points(tmp_path: Path) -> None:
    scenes = images(tmp_path, image())
    scene = scenes.load("0")
    assert (scenes.names(), scene.group) == (["0"], "val")
    assert scene.cloud is not None
    assert scene.cloud.xyz.tolist() == [[2, 10, 0.5], [-3, -4, -1.7]]
    numbers, names, label_set = class_labels(scene.cloud)
    assert [names[number] for number in numbers] == ["car", "road"]
    assert label_set == "semantickitti_benchmark"
    assert scene.cloud.fields["remission"].tolist() == [0.3, 0.25]


def test_images_of_nuscenes_have_labels_and_axes_of_their_own(tmp_path: Path) -> None:
    scenes = images(tmp_path, image(), labels="pclsegmentation", forward="y")
    cloud = scenes.load("0").cloud
    assert cloud is not None
    assert cloud.xyz.tolist() == [[10, -2, 0.5], [-4, 3, -1.7]]
    numbers, names, _ = class_labels(cloud)
    assert [names[number] for number in numbers] == ["Sidewalk", "Bus"]
    assert not cloud.fields


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        (image(20), r"0\.npy: label 20 is none of the 20 labels of semantickitti_benchmark"),
        (image(1.5), r"0\.npy: label 1\.5 is none of the 20 labels"),
        (image()[:, :, :5], r"0\.npy: 2 x 3 x 5 values of float64, not rows x columns x 6"),
        (image()[0], r"0\.npy: 3 x 6 values of float64, not rows x columns x 6"),
        (0 * image(), r"0\.npy: the cloud is empty"),
    ],
)
def test_images_of_another_form_are_refused(tmp_path: Path, wrong: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        images(tmp_path, wrong).load("0")
