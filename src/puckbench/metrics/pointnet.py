"""PointNet, which classifies objects by their points, with weights of the repository learning3d.

The network has five layers that act on every point, the maximum of their outputs over all points,
and three layers that turn these 1024 features into scores of classes. Each layer but the last is
followed by batch normalisation and max(0, x). Layers and normalisation are merged into one matrix
each, in double precision, so that results hardly depend on the machine.

References
----------
C. R. Qi et al., "PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation",
CVPR 2017.
V. Sarode et al., learning3d, github.com/vinits5/learning3d (MIT).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

CLASSES = (
    *("airplane", "bathtub", "bed", "bench", "bookshelf", "bottle", "bowl", "car", "chair"),
    *("cone", "cup", "curtain", "desk", "door", "dresser", "flower_pot", "glass_box", "guitar"),
    *("keyboard", "lamp", "laptop", "mantel", "monitor", "night_stand", "person", "piano"),
    *("plant", "radio", "range_hood", "sink", "sofa", "stairs", "stool", "table", "tent"),
    *("toilet", "tv_stand", "vase", "wardrobe", "xbox"),
)
"""The 40 classes of ModelNet40, in the order of the network's scores."""
_OF_POINTS = tuple((f"feature_model.conv{k}", f"feature_model.bn{k}") for k in range(1, 6))
_OF_OBJECT = (("linear1", "bn1"), ("linear2", "bn2"), ("linear3", ""))
_WIDTHS = (3, 64, 64, 64, 128, 1024, 512, 256, len(CLASSES))
_EPSILON = 1e-5
"""What batch normalisation adds to variances."""


class Layer(NamedTuple):
    """A layer that maps x to ``x @ matrix + offset``, with (inputs, outputs) and (outputs,)."""

    matrix: Floats
    offset: Floats


class PointNet(NamedTuple):
    """The network: layers that act on each point, and those that act on the whole object."""

    of_points: tuple[Layer, ...]
    of_object: tuple[Layer, ...]

    def probabilities(self, points: Floats) -> Floats:
        """Return the probabilities of the `CLASSES`, (40,), for the points (n, 3) of an object.

        The points are centred on 0, in the unit sphere, with y up (`in_unit_sphere`).
        """
        scores = self.scores(points)
        shares = np.exp(scores - scores.max())
        return np.asarray(shares / shares.sum())

    def scores(self, points: Floats) -> Floats:
        """Return the network's outputs (40,), the logarithms of unnormalised probabilities."""
        features = points
        for layer in self.of_points:
            features = np.maximum(features @ layer.matrix + layer.offset, 0)
        features = features.max(axis=0)
        *hidden, last = self.of_object
        for layer in hidden:
            features = np.maximum(features @ layer.matrix + layer.offset, 0)
        return np.asarray(features @ last.matrix + last.offset)


def read_pointnet(path: Path) -> PointNet:
    """Read the weights of a PointNet that learning3d trained on ModelNet40.

    Raises InputError if the file has other weights or is damaged. PyTorch reads the file, and runs
    no code from it.
    """
    from pcc_networks.weights_file import read_checkpoint

    fault = "not the weights of learning3d's PointNet for ModelNet40"
    if not path.is_file():
        raise InputError(f"{path}: no such file; it needs {path.name} of vinits5/learning3d")
    state = read_checkpoint(path, fault)
    try:
        layers = tuple(_layer(state, *names) for names in (*_OF_POINTS, *_OF_OBJECT))
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise InputError(f"{path}: {fault}") from error
    if [layers[0].matrix.shape[0], *(layer.matrix.shape[1] for layer in layers)] != [*_WIDTHS]:
        raise InputError(f"{path}: {fault}: layers of other widths")
    return PointNet(layers[: len(_OF_POINTS)], layers[len(_OF_POINTS) :])


def _layer(state: Mapping[str, Any], name: str, normalisation: str) -> Layer:
    def numbers(key: str) -> Floats:
        return np.asarray(state[key].numpy(), np.float64)

    matrix = numbers(f"{name}.weight")
    matrix = matrix.reshape(matrix.shape[:2]).T
    offset = numbers(f"{name}.bias")
    if normalisation:
        mean, variance, scale, shift = (
            numbers(f"{normalisation}.{part}")
            for part in ("running_mean", "running_var", "weight", "bias")
        )
        factor = scale / np.sqrt(variance + _EPSILON)
        matrix, offset = matrix * factor, (offset - mean) * factor + shift
    return Layer(matrix, offset)


def in_unit_sphere(points: Floats) -> Floats:
    """Centre points (n, 3) on their mean, and scale the farthest to distance 1, as in training."""
    centred = points - points.mean(axis=0)
    return np.asarray(centred / max(float(np.linalg.norm(centred, axis=1).max()), 1e-12))


def y_up(points: Floats, quarter_turns: int = 0) -> Floats:
    """Return points (n, 3) with z up in the axes of the network's training, which has y up.

    Before, the points are turned counter-clockwise about z by some quarter turns.
    """
    cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter_turns % 4]
    x, y, z = points.T
    return np.column_stack([cosine * x - sine * y, z, -(sine * x + cosine * y)])
