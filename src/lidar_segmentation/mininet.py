"""3D-MiniNet (Alonso 2020) with its published weights: the class of each point of an HDL-64E scan.

References
----------
I. Alonso et al., "3D-MiniNet: Learning a 2D Representation from Point Clouds for Fast and Efficient
3D LIDAR Semantic Segmentation", IROS 2020; github.com/Shathe/3D-MiniNet.
A. Milioto et al., "RangeNet++: Fast and Accurate LiDAR Semantic Segmentation", IROS 2019 (range
image, and the vote of neighbours that follows the network).
"""

from __future__ import annotations

import hashlib
import math
import pickle
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_segmentation.class_maps import ClassMap
from lidar_segmentation.scan_points import checked_points
from pointkit.confusion import IGNORED
from pointkit.errors import InputError
from pointkit.files import read_bytes, refuse_special

if TYPE_CHECKING:
    from torch import Tensor

    from lidar_segmentation.mininet_module import MiniNetModule

PARTS = {"backbone": "backbone", "decoder": "segmentation_decoder", "head": "segmentation_head"}
"""Files of the folder of weights, by the part of the network."""
CLASSES = (
    *("car", "bicycle", "motorcycle", "truck", "other-vehicle", "person", "bicyclist"),
    *("motorcyclist", "road", "parking", "sidewalk", "other-ground", "building", "fence"),
    *("vegetation", "trunk", "terrain", "pole", "traffic-sign"),
)
"""Classes of the network; it numbers them from 1, and 0 is "unlabeled"."""
_ALIKE = {
    "bus": "other-vehicle", "on-rails": "other-vehicle", "lane-marking": "road",
    "moving-car": "car", "moving-bicyclist": "bicyclist", "moving-person": "person",
    "moving-motorcyclist": "motorcyclist", "moving-on-rails": "other-vehicle",
    "moving-bus": "other-vehicle", "moving-truck": "truck", "moving-other-vehicle": "other-vehicle",
}  # fmt: skip
"""Labels of SemanticKITTI that count as a class of another name."""
_UNJUDGED = ("unlabeled", "outlier", "other-structure", "other-object")
_LABEL_SETS = ("semantickitti", "semantickitti_benchmark")

ROWS, COLUMNS = 64, 2048
_COARSEST = 8
"""Columns of the image in one of the coarsest features."""
_UP_DEG, _DOWN_DEG = 3.0, -25.0
_MEANS, _DEVIATIONS = (12.12, 10.88, 0.23, -1.04, 0.21), (12.32, 11.47, 6.91, 0.86, 0.16)
"""Of range, x, y, z in m (x forward, y left) and remission, over the pixels of the training."""
_VOTES, _SEARCHED, _SIGMA, _CUTOFF_M = 7, 7, 1.0, 2.0
_POINTS_AT_A_TIME = 50_000
_DIGEST_DIGITS = 16
_MAX_BYTES = 2**26
_DAMAGE = (pickle.UnpicklingError, RuntimeError, EOFError, KeyError, ValueError, AttributeError)

Singles = NDArray[np.float32]


class RangeImage(NamedTuple):
    """A scan that is projected to an image: each pixel has the values of the nearest point in it.

    Parameters
    ----------
    channels
        Range, x, y, z in m (x forward, y left) and remission of each pixel,
        (5, rows, columns); -1 in pixels without a point.
    mask
        Whether a pixel has a point, (rows, columns).
    row, column
        Pixel of each point of the scan, (n,).
    ranges
        Range of each point, (n,), m.
    """

    channels: Singles
    mask: NDArray[np.bool_]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    ranges: Singles


def range_image(xyz: Singles, remission: Singles, columns: int = COLUMNS) -> RangeImage:
    """Project a scan to the range image of an HDL-64E.

    As in the published program, angles above and below the field of view get the first and last
    row, and a pixel whose nearest point is the first point of the scan counts as empty.

    Parameters
    ----------
    xyz
        Points (n, 3), m, with the axes x forward, y left, z up.
    remission
        Share of the light that came back, (n,), 0 to 1.
    columns
        Number of columns of the image.
    """
    ranges = np.linalg.norm(xyz, 2, axis=1)
    up, down = (abs(angle) / 180.0 * np.pi for angle in (_UP_DEG, _DOWN_DEG))
    turned = 0.5 * (-np.arctan2(xyz[:, 1], xyz[:, 0]) / np.pi + 1.0) * columns
    heights = np.divide(xyz[:, 2], ranges, out=np.zeros_like(ranges), where=ranges > 0)
    lowered = (1.0 - (np.arcsin(np.clip(heights, -1, 1)) + down) / (down + up)) * ROWS
    column = np.clip(np.floor(turned), 0, columns - 1).astype(np.int64)
    row = np.clip(np.floor(lowered), 0, ROWS - 1).astype(np.int64)
    far_first = np.argsort(ranges)[::-1]
    channels = np.full((5, ROWS, columns), -1, np.float32)
    places = np.full((ROWS, columns), -1, np.int64)
    pixel = row[far_first], column[far_first]
    values = np.column_stack([ranges, xyz, remission])
    channels[:, pixel[0], pixel[1]] = values[far_first].T
    places[pixel] = far_first
    return RangeImage(channels, places > 0, row, column, ranges)


def network_input(image: RangeImage) -> tuple[Singles, Singles]:
    """Return the normalised image (5, rows, columns) and the windows (11, 16, windows) of a scan.

    The windows have the channels of `lidar_segmentation.mininet_module`, pixel by pixel.
    """
    mask = image.mask.astype(np.float32)
    raw = image.channels * mask
    means, deviations = (
        np.array(each, np.float32)[:, None, None] for each in (_MEANS, _DEVIATIONS)
    )
    normalised = (raw - means) / deviations * mask
    there, points = _windows(mask[None]), _windows(raw)
    count = there.sum(axis=1)
    mean = np.divide(points.sum(axis=1), count, out=np.zeros_like(points[:, 0]), where=count > 0)
    relative = np.where(there > 0, points - mean[:, None], np.float32(0))
    distance = np.linalg.norm(relative[1:4], ord=2, axis=0)[None]
    return normalised, np.concatenate([_windows(normalised), relative, distance]).astype(np.float32)


def _windows(image: Singles) -> Singles:
    """Return the pixels of each window, (channels, 16, windows), of (channels, rows, columns)."""
    from lidar_segmentation.mininet_module import SIDE

    channels, rows, columns = image.shape
    split = image.reshape(channels, rows // SIDE, SIDE, columns // SIDE, SIDE)
    return split.transpose(0, 2, 4, 1, 3).reshape(channels, SIDE * SIDE, -1)


@dataclass(frozen=True)
class MiniNet:
    """3D-MiniNet with published weights, which names the class of each point of a scan.

    `open_mininet` opens it. Its scans are those of an HDL-64E: other sensors fill other rows of
    its range image than those of its training.

    Parameters
    ----------
    digest
        16 hexadecimal digits that identify the files of weights.
    module
        The network as a PyTorch module.
    columns
        Number of columns of the range image.
    """

    digest: str
    module: MiniNetModule
    columns: int = COLUMNS

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes, in the order of their numbers."""
        return CLASSES

    def class_map(self, label_set: str) -> ClassMap:
        """Return which class of the network each label is.

        Raises InputError for other label sets than ``semantickitti`` and
        ``semantickitti_benchmark``.
        """
        if label_set not in _LABEL_SETS:
            raise InputError(
                f"labels {label_set} have no classes of 3D-MiniNet, which knows those of "
                f"{' and '.join(_LABEL_SETS)}"
            )
        numbers: dict[str | int, int] = {name: place for place, name in enumerate(CLASSES)}
        numbers |= {name: CLASSES.index(same) for name, same in _ALIKE.items()}
        numbers |= dict.fromkeys(_UNJUDGED, IGNORED)
        itself = np.arange(len(CLASSES), dtype=np.uint8)
        return ClassMap(label_set, "3D-MiniNet", CLASSES, numbers, itself)

    def predict(
        self, xyz: NDArray[np.floating], remission: NDArray[np.floating] | None = None
    ) -> NDArray[np.uint8]:
        """Return the class of each point of a scan.

        The network judges the pixels of a range image; then each point gets the class of most of
        the 7 nearest of the 49 pixels around it, as published.

        Parameters
        ----------
        xyz
            Points (n, 3) in the sensor's frame, m: x right, y forward, z up, the sensor at the
            origin.
        remission
            Share of the light that came back from each point, (n,), 0 to 1; by default that of the
            training's mean.

        Returns
        -------
        ndarray
            Numbers (n,) of classes.

        Raises
        ------
        InputError
            The points have another shape, or are not finite; or no point is in a pixel.
        """
        import torch

        points = checked_points(xyz)
        if not len(points):
            return np.empty(0, np.uint8)
        ahead = np.column_stack([points[:, 1], -points[:, 0], points[:, 2]]).astype(np.float32)
        light = np.full(len(points), _MEANS[-1]) if remission is None else remission
        image = range_image(ahead, np.asarray(light, np.float32), self.columns)
        normalised, windows = (torch.from_numpy(each)[None] for each in network_input(image))
        with torch.inference_mode():
            logits = self.module(normalised, windows)
            return _voted(image, logits[0].argmax(dim=0))


def _voted(image: RangeImage, classes: Tensor) -> NDArray[np.uint8]:
    """Return the class of each point by the vote of near pixels.

    Neighbours compete by the difference of ranges, which counts less the nearer their pixel is. The
    class 0 and pixels that differ by more than 2 m do not vote.
    """
    import torch
    from torch.nn import functional

    around = {"kernel_size": _SEARCHED, "padding": _SEARCHED // 2}
    ranges = torch.from_numpy(image.channels[:1])
    near = functional.unfold(ranges[None], **around)[0]
    near[near < 0] = math.inf
    votes = functional.unfold(classes[None, None].float(), **around)[0].long()
    weights = (1 - _gaussian()).reshape(-1, 1)
    pixel = torch.from_numpy(image.row * image.channels.shape[2] + image.column)
    own, found = torch.from_numpy(image.ranges), []
    for first in range(0, len(own), _POINTS_AT_A_TIME):
        part = slice(first, first + _POINTS_AT_A_TIME)
        compared = near[:, pixel[part]]
        compared[_SEARCHED**2 // 2] = own[part]
        apart = (compared - own[part]).abs() * weights
        nearest, rows = apart.topk(_VOTES, dim=0, largest=False, sorted=False)
        chosen = votes[:, pixel[part]].gather(0, rows)
        chosen[nearest > _CUTOFF_M] = len(CLASSES) + 1
        counts = torch.zeros(len(CLASSES) + 2, chosen.shape[1])
        counts.scatter_add_(0, chosen, torch.ones_like(chosen, dtype=counts.dtype))
        found.append(counts[1:-1].argmax(dim=0).to(torch.uint8).numpy())
    return np.concatenate(found)


def _gaussian() -> Tensor:
    """Return the weights of a Gaussian in the searched pixels, which sum to 1."""
    import torch

    away = torch.arange(_SEARCHED, dtype=torch.float32) - _SEARCHED // 2
    squared = away[:, None] ** 2 + away[None] ** 2
    values = 1.0 / (2.0 * math.pi * _SIGMA**2) * torch.exp(-squared / (2 * _SIGMA**2))
    return values / values.sum()


def mininet_files(folder: Path) -> tuple[Path, ...]:
    """Return the files of weights in a folder; raise InputError if one is missing."""
    files = tuple(folder / name for name in PARTS.values())
    for file in files:
        if not file.is_file():
            names = ", ".join(PARTS.values())
            raise InputError(f"{file}: no such file; the weights of 3D-MiniNet are {names}")
    return files


def open_mininet(folder: Path, columns: int = COLUMNS) -> MiniNet:
    """Open 3D-MiniNet with the weights in a folder.

    Parameters
    ----------
    folder
        Folder with the files ``backbone``, ``segmentation_decoder`` and ``segmentation_head``, as
        published for 3D-MiniNet-tiny and the larger networks. The numbers of blocks are those of
        the weights: the file beside the published ones names another.
    columns
        Number of columns of the range image, a multiple of 8; by default the published one.

    Raises
    ------
    InputError
        A file is missing, damaged, or has weights of another network.
    """
    if columns < _COARSEST or columns % _COARSEST:
        raise InputError(f"columns: {columns} is not a multiple of {_COARSEST}")
    files = mininet_files(folder)
    digest = hashlib.sha256(b"".join(map(read_bytes, files))).hexdigest()
    states = dict(zip(PARTS, map(_state, files), strict=True))
    try:
        module = _module_of(states)
        for part, state in states.items():
            module.get_submodule(part).load_state_dict(state)
    except (KeyError, RuntimeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(f"{folder}: weights of another network than 3D-MiniNet") from error
    return MiniNet(digest[:_DIGEST_DIGITS], module.eval(), columns)


def _state(file: Path) -> dict[str, Tensor]:
    import torch

    refuse_special(file)
    if file.stat().st_size > _MAX_BYTES:
        raise InputError(f"{file}: damaged weights (more than {_MAX_BYTES} bytes)")
    try:
        state: Any = torch.load(file, map_location="cpu", weights_only=True)
    except _DAMAGE as error:
        raise InputError(f"{file}: damaged weights, or not weights of PyTorch") from error
    if not isinstance(state, Mapping) or not all(
        isinstance(each, torch.Tensor) and bool(torch.isfinite(each).all())
        for each in state.values()
    ):
        raise InputError(f"{file}: damaged weights (not finite numbers by name)")
    return dict(state)


def _module_of(states: Mapping[str, Mapping[str, Tensor]]) -> MiniNetModule:
    """Return a network with the sizes of some weights."""
    from lidar_segmentation.mininet_module import MiniNetModule

    backbone, decoder = states["backbone"], states["decoder"]
    width = int(backbone["proj.conv_out.weight"].shape[0])
    classes = int(states["head"]["0.weight"].shape[0])
    if classes != len(CLASSES) + 1:
        raise ValueError(f"{classes} classes")
    blocks = (
        _count(backbone, r"enc2\.residual_(\d+)\."),
        _count(backbone, r"enc3\.residual_(\d+)\."),
    )
    back = _count(decoder, r"dec4\.residual(\d*)\."), _count(decoder, r"dec3\.residual(\d*)\.")
    return MiniNetModule(width, blocks, back, classes)


def _count(state: Mapping[str, Any], pattern: str) -> int:
    return len({found[1] for name in state if (found := re.match(pattern, name))})
