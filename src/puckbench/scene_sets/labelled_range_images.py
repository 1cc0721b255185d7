"""Labelled range images of PCLSegmentation (RWTH Aachen): one array of NumPy for each scan.

References
----------
github.com/ika-rwth-aachen/PCLSegmentation, ``dataset_convert/README.md``: arrays (rows, columns, 6)
of x, y, z in m, intensity, depth in m and label; pixels without a point are 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from cloud_files.npy import read_array
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud, check_points
from puckbench.geometry.labels import (
    PCL_SEGMENTATION,
    REMISSION,
    SEMANTIC_KITTI_20,
    described_classes,
)
from puckbench.scene_sets.base import FolderSet
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name

CODE = ("puckbench.geometry.labels", "cloud_files.npy")

_CHANNELS = 6
_INTENSITY, _DEPTH, _LABEL = 3, 4, 5
LABELS: Mapping[str, tuple[str, ...]] = {
    SEMANTIC_KITTI_20: (
        *("unlabeled", "car", "bicycle", "motorcycle", "truck", "other-vehicle", "person"),
        *("bicyclist", "motorcyclist", "road", "parking", "sidewalk", "other-ground"),
        *("building", "fence", "vegetation", "trunk", "terrain", "pole", "traffic-sign"),
    ),
    PCL_SEGMENTATION: (
        *("Road", "Sidewalk", "Building", "Pole", "Vegetation", "Person", "Two-wheeler"),
        *("Car", "Truck", "Bus", "None"),
    ),
}
"""Names of the classes of each set of labels, by number."""


@LOADERS.register("labelled_range_images")
class LabelledRangeImages(FolderSet):
    """The scenes are labelled range images ``*.npy`` with x, y, z, intensity, depth and label.

    This is the form of PCLSegmentation's samples: of SemanticKITTI, with the axes x forward, y
    left and the 20 labels of its benchmark; of nuScenes, with x right, y forward and 11 labels of
    its own (``labels: pclsegmentation, forward: y``); and of a VLP-32C that looks ahead, with x
    forward and these 11 labels. Scenes have the axes x right, y forward, z up, and the sensor at
    (0, 0, 0). Points are ordered by row and column. Pixels with depth 0 are no points. Intensities
    of SemanticKITTI, which are from 0 to 1, become the field ``remission``.
    """

    of_clouds: ClassVar[bool] = True
    licence = "that of the data set from which the range images were made"
    credit = "Institute for Automotive Engineering of RWTH Aachen University, PCLSegmentation"
    expected = "expected range images (.npy) of x, y, z, intensity, depth and label"

    labels: Literal["semantickitti_benchmark", "pclsegmentation"] = "semantickitti_benchmark"
    """Meaning of the labels: the 20 classes of SemanticKITTI's benchmark, or PCLSegmentation's 11.
    """
    forward: Literal["x", "y"] = "x"
    """Axis of the arrays that points forward; the other one then points left, or right."""

    def listed(self, folder: Path) -> Mapping[str, Path]:
        paths = [path for path in sorted(folder.glob("*.npy")) if not path.name.startswith(".")]
        if not paths:
            raise self.missing("range images (.npy)")
        return {safe_name(path.stem): path for path in paths}

    def load(self, name: str) -> Scene:
        path = self.file_of(name)
        pixels = _checked(read_array(path), path).reshape(-1, _CHANNELS)
        pixels = pixels[pixels[:, _DEPTH] > 0]
        xyz = pixels[:, :3].astype(np.float64)
        check_points(xyz, str(path))
        if self.forward == "x":
            xyz = np.column_stack([-xyz[:, 1], xyz[:, 0], xyz[:, 2]])
        classes = self._classes(pixels[:, _LABEL], path)
        about = self.about(path.name, **described_classes(LABELS[self.labels], self.labels))
        is_kitti = self.labels == SEMANTIC_KITTI_20
        light = {REMISSION: pixels[:, _INTENSITY].astype(np.float64)} if is_kitti else {}
        cloud = PointCloud(xyz, labels=classes, about=about, fields=light)
        group = safe_name(path.parent.name)
        return Scene(name, group, cloud=cloud, origin=(0.0, 0.0, 0.0), about=about)

    def _classes(self, values: NDArray[Any], path: Path) -> NDArray[np.int32]:
        known = np.arange(len(LABELS[self.labels]))
        if len(unknown := values[~np.isin(values, known)]):
            what = f"none of the {len(known)} labels of {self.labels}"
            raise InputError(f"{path}: label {unknown[0]:g} is {what}")
        return values.astype(np.int32)


def _checked(image: NDArray[Any], path: Path) -> NDArray[Any]:
    if image.ndim != 3 or image.shape[2] != _CHANNELS or image.dtype.kind != "f":
        form = " x ".join(map(str, image.shape))
        raise InputError(
            f"{path}: {form} values of {image.dtype}, not rows x columns x 6 floating-point numbers"
        )
    return image
