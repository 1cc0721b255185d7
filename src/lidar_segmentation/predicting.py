"""Prediction of the class of each point of a scan, with shipped weights or a file of weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lidar_segmentation.class_maps import ClassMap, class_map
from lidar_segmentation.grid import gridded
from lidar_segmentation.mininet import MiniNet, open_mininet
from lidar_segmentation.scan_points import checked_points
from lidar_segmentation.weights_file import read_weights, weights_path
from pointkit.errors import InputError
from pointkit.models import parsed

if TYPE_CHECKING:
    from lidar_segmentation.network import SegmentationModule

_POINTS_AT_A_TIME = 50_000
_OF_SCENES = ("streets", "rooms")


@dataclass(frozen=True)
class SegmentationNetwork:
    """A trained network that names the class of each point of a scan.

    `open_network` opens it.

    Parameters
    ----------
    classes
        Names of the classes, in the order of their numbers.
    digest
        16 hexadecimal digits that identify the file of weights.
    card
        Model card: the data and settings of the training, and what was measured.
    module
        The network as a PyTorch module, in single precision.
    """

    classes: tuple[str, ...]
    digest: str
    card: Mapping[str, Any]
    module: SegmentationModule

    @property
    def cell_m(self) -> tuple[float, float, float]:
        """Size of a cell of the grid on which the network sees a scan, along x, y and z, m."""
        shape = self.module.shape
        return (shape.cell_m, shape.cell_m, shape.bin_m)

    def class_map(self, label_set: str) -> ClassMap:
        """Return which class of the network each label is.

        Parameters
        ----------
        label_set
            Name of a label set (`class_map_names`), or ``scene`` for the semantic classes of the
            virtual scenes on which the network was trained.

        Raises
        ------
        InputError
            The labels have no classes of this network.
        """
        names = _OF_SCENES if label_set == "scene" else (label_set,)
        found = [named for named in map(class_map, names) if named.classes == self.classes]
        if not found:
            known = ", ".join(self.classes)
            raise InputError(f"labels {label_set} have no classes of the network ({known})")
        return found[0]

    def predict(self, xyz: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Return the class of each point of a scan.

        Parameters
        ----------
        xyz
            Points (n, 3) in the sensor's frame, m: x right, y forward, z up, the sensor at the
            origin. Their order, and points that are there twice, change nothing.

        Returns
        -------
        ndarray
            Numbers (n,) of classes.

        Raises
        ------
        InputError
            The points have another shape, or are not finite.
        """
        points = checked_points(xyz)
        if not len(points):
            return np.empty(0, np.uint8)
        return self._predicted(points)

    def _predicted(self, points: NDArray[np.floating]) -> NDArray[np.uint8]:
        import torch

        scan = gridded(points, self.module.shape)
        kind = next(self.module.parameters()).dtype
        columns, places, features = (
            torch.from_numpy(each).to(kind) for each in (scan.columns, scan.places, scan.features)
        )
        classes = []
        with torch.inference_mode():
            cells = self.module.cells(columns[None])
            for first in range(0, len(points), _POINTS_AT_A_TIME):
                part = slice(first, first + _POINTS_AT_A_TIME)
                logits = self.module.classified(cells, [places[part]], [features[part]])
                classes.append(logits.argmax(dim=1).to(torch.uint8).numpy())
        return np.concatenate(classes)


def open_network(where: str | Path) -> SegmentationNetwork | MiniNet:
    """Open a trained network.

    Parameters
    ----------
    where
        Name of weights that come with the package (``streets``, ``rooms``), the path of a file, or
        that of a folder with the published weights of 3D-MiniNet.

    Raises
    ------
    InputError
        There is no such file, or it is damaged or of another network.
    """
    import torch

    from lidar_segmentation.network import NetworkShape, SegmentationModule, fused

    if Path(where).is_dir():
        return open_mininet(Path(where))
    path = weights_path(where)
    contents = read_weights(path)
    shape = parsed(NetworkShape, contents.header.shape, f"{path}: shape")
    module = fused(SegmentationModule(shape))
    state = {name: torch.from_numpy(each).float() for name, each in contents.arrays.items()}
    try:
        module.load_state_dict(state)
    except RuntimeError as error:
        raise InputError(f"{path}: weights of another network") from error
    return SegmentationNetwork(shape.classes, contents.digest, contents.header.card, module)
