"""SemanticKITTI (Behley 2019): frames of KITTI's odometry benchmark with a class for each point.

References
----------
J. Behley et al., "SemanticKITTI: A Dataset for Semantic Scene Understanding of LiDAR Sequences",
ICCV 2019. Files ``.label`` have an unsigned integer of 32 bits for each point of the file ``.bin``
of the same name: the lower 16 bits are the class, the upper 16 bits the object.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import UncheckedCloud
from puckbench.geometry.labels import REMISSION, SEMANTIC_KITTI, described_classes
from puckbench.scene_sets.kitti import TURNED, Kitti, cloud_of_rows, frame_rows
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene

CODE = ("puckbench.scene_sets.kitti", "puckbench.geometry.labels")

CLASSES: Mapping[int, str] = {
    0: "unlabeled", 1: "outlier", 10: "car", 11: "bicycle", 13: "bus", 15: "motorcycle",
    16: "on-rails", 18: "truck", 20: "other-vehicle", 30: "person", 31: "bicyclist",
    32: "motorcyclist", 40: "road", 44: "parking", 48: "sidewalk", 49: "other-ground",
    50: "building", 51: "fence", 52: "other-structure", 60: "lane-marking", 70: "vegetation",
    71: "trunk", 72: "terrain", 80: "pole", 81: "traffic-sign", 99: "other-object",
    252: "moving-car", 253: "moving-bicyclist", 254: "moving-person", 255: "moving-motorcyclist",
    256: "moving-on-rails", 257: "moving-bus", 258: "moving-truck", 259: "moving-other-vehicle",
}  # fmt: skip
"""Names of the published classes by number in files ``.label``."""
NAMES = tuple(CLASSES.values())
_CLASS_BITS = 0xFFFF
_AXES = TURNED[:3, :3]


@LOADERS.register("semantickitti")
class SemanticKitti(Kitti):
    """The scenes are the frames of SemanticKITTI's labelled sequences, in metres.

    The folder contains ``sequences/00/velodyne/000000.bin`` and
    ``sequences/00/labels/000000.label``. Frames without labels, such as those of the test
    sequences, are not listed. Points have the axes x right, y forward, z up, and the sensor is at
    (0, 0, 0). Every point has one of the published classes and, as the field ``remission``, the
    share of light that came back. Scenes of the option `returns` have neither.
    """

    licence = "CC BY-NC-SA 4.0"
    credit = 'J. Behley et al., "SemanticKITTI: A Dataset for Semantic Scene Understanding", 2019'
    expected = (
        "expected SemanticKITTI, with sequences/00/velodyne and sequences/00/labels; download at "
        "semantic-kitti.org"
    )

    def files(self, name: str) -> list[Path]:
        return [*super().files(name), label_file(self.file_of(name))]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        labelled = {
            name: path
            for name, path in super().listed(folder).items()
            if label_file(path).is_file()
        }
        if not labelled:
            raise self.missing("labelled frames (.bin and .label)")
        return labelled

    def read(self, path: Path) -> UncheckedCloud:
        rows = frame_rows(path)
        light = {REMISSION: rows[:, 3].astype(np.float64)}
        labels = read_labels(label_file(path), len(rows))
        return replace(cloud_of_rows(rows), labels=labels, fields=light)

    def load(self, name: str) -> Scene:
        scene = super().load(name)
        if scene.cloud is None:
            return scene
        about = {**scene.about, **described_classes(NAMES, SEMANTIC_KITTI)}
        cloud = replace(scene.cloud, xyz=scene.cloud.xyz @ _AXES, about=about)
        pose = None if scene.pose is None else scene.pose @ TURNED
        return replace(scene, cloud=cloud, about=about, pose=pose)


def label_file(frame: Path) -> Path:
    """Return the path of the file with the labels of a frame ``velodyne/000000.bin``."""
    return frame.parent.parent / "labels" / f"{frame.stem}.label"


def read_labels(path: Path, points: int) -> NDArray[np.int32]:
    """Read the classes of a frame's points from a file ``.label``.

    Parameters
    ----------
    path
        The file.
    points
        Number of points of the frame.

    Returns
    -------
    array
        Class of each point, (points,) int32, an index into `NAMES`.

    Raises
    ------
    InputError
        The file has another number of labels, or a label that is none of the published classes.
    """
    data = read_bytes(path)
    if len(data) != 4 * points:
        raise InputError(f"{path}: {len(data) / 4:g} labels for the {points} points of the frame")
    return places_of(np.frombuffer(data, "<u4") & _CLASS_BITS, path)


def places_of(numbers: NDArray[np.integer[Any]], path: Path) -> NDArray[np.int32]:
    """Convert published numbers of classes to indices into `NAMES`.

    Raises InputError, which names the file `path`, for a number that is not published.
    """
    places = np.full(_CLASS_BITS + 1, -1, np.int32)
    places[list(CLASSES)] = np.arange(len(CLASSES))
    found: NDArray[np.int32] = places[numbers]
    if (found < 0).any():
        raise InputError(f"{path}: {numbers[found < 0][0]} is none of SemanticKITTI's classes")
    return found
