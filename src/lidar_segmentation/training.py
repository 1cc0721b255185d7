"""Training of the network on labelled scans: settings, examples, loss and export."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, PositiveInt

from lidar_segmentation.class_maps import class_map
from lidar_segmentation.grid import Gridded, GridShape, Singles, gridded
from pointkit.confusion import IGNORED
from pointkit.errors import InputError
from pointkit.seeding import generator, random_rows

if TYPE_CHECKING:
    from torch import Tensor

    from lidar_segmentation.network import NetworkShape, SegmentationModule

Share = Annotated[float, Field(gt=0, le=1)]
Channels = Annotated[int, Field(ge=1, le=256)]


@dataclass(frozen=True)
class LabelledScan:
    """A scan with the class of each point.

    Parameters
    ----------
    xyz
        Points (n, 3) in the sensor's frame, m.
    classes
        Numbers (n,) of their classes; `IGNORED` for points that are not judged.
    joins
        `ClassMap.joins` of the labels; None if they tell all classes apart.
    """

    xyz: Singles
    classes: NDArray[np.uint8]
    joins: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        if self.xyz.shape != (len(self.classes), 3):
            raise InputError(
                f"{len(self.classes)} labels for points {self.xyz.shape}: one for each is needed"
            )

    def joined(self, predicted: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return predicted classes (n,) as they are compared with `classes`."""
        return predicted if self.joins is None else self.joins[predicted]


@dataclass(frozen=True)
class Example:
    """A scan of a training step: the scan as the network sees it, and what it should say.

    Parameters
    ----------
    scan
        The scan on its grid, with the places and features of the points that the loss judges.
    classes
        Their classes (m,).
    """

    scan: Gridded
    classes: NDArray[np.uint8]


class SegmentationTraining(GridShape):
    """Settings of a training.

    Parameters
    ----------
    labels
        Name of the label set (`class_map`), whose network has the classes.
    channels, hidden
        Sizes of the network (`NetworkShape`).
    steps, batch_size
        Number of steps of the optimiser, and of scans in a step.
    learning_rate, final_learning_rate
        Learning rates at the start and at the end of a cosine schedule.
    seed
        Seed of the initial weights and of all random choices.
    crop_cells
        Side of the square of cells, somewhere in the grid, on which a step trains.
    points
        Number of points of a scan that the loss judges, drawn at random in this square; a sixteenth
        as many are drawn outside.
    kept_share
        A scan keeps a random share of its points, at least this one.
    height_m
        Greatest random change of the sensor's height, m.
    tilt_deg
        Greatest random tilt of the sensor, degrees.
    shift_m
        Greatest random shift of the sensor along x and y, m.
    jitter_m
        Greatest standard deviation of noise that is added to the points, m.
    """

    labels: str = "streets"
    channels: tuple[Channels, Channels, Channels, Channels] = (24, 32, 48, 64)
    hidden: Channels = 64
    steps: PositiveInt = 2000
    batch_size: PositiveInt = 2
    learning_rate: PositiveFloat = 3e-3
    final_learning_rate: PositiveFloat = 3e-5
    seed: Annotated[int, Field(ge=0)] = 1
    crop_cells: Annotated[int, Field(ge=8, le=1024, multiple_of=8)] = 128
    points: PositiveInt = 16_000
    kept_share: Share = 0.5
    height_m: Annotated[float, Field(ge=0, le=5)] = 0.25
    tilt_deg: Annotated[float, Field(ge=0, le=30)] = 1.5
    shift_m: Annotated[float, Field(ge=0, le=10)] = 0.3
    jitter_m: Annotated[float, Field(ge=0, le=1)] = 0.02

    def shape(self) -> NetworkShape:
        """Return the sizes of the network."""
        from lidar_segmentation.network import NetworkShape

        names = {*GridShape.model_fields, "channels", "hidden"}
        sizes = {name: getattr(self, name) for name in names}
        return NetworkShape(classes=class_map(self.labels).classes, **sizes)

    def module(self) -> SegmentationModule:
        """Return a new network, whose initial weights depend on the seed."""
        import torch

        from lidar_segmentation.network import SegmentationModule

        torch.manual_seed(self.seed)
        return SegmentationModule(self.shape())

    def examples(self, scans: Sequence[LabelledScan]) -> Examples:
        """Return the examples of a training on scans.

        Raises InputError if there is no scan, or no point that is judged.
        """
        if not any((scan.classes != IGNORED).any() for scan in scans):
            raise InputError("no scan has a point with a class of the network")
        return Examples(self, scans, class_weights(scans, len(class_map(self.labels).classes)))

    def export(self, path: Path, model: SegmentationModule, card: Mapping[str, Any]) -> None:
        """Write a trained network with its model card to a file that `open_network` reads."""
        from lidar_segmentation.network import fused
        from lidar_segmentation.weights_file import write_weights

        write_weights(path, model.shape, fused(model).state_dict(), card)


@dataclass(frozen=True)
class Examples:
    """Scans that are turned, tilted, shifted and thinned out at random, as examples for training.

    The seed and the number of a step determine the examples of this step.

    Parameters
    ----------
    settings
        Settings of the training.
    scans
        The scans.
    weights
        Weight of each class in the loss (`class_weights`).
    """

    settings: SegmentationTraining
    scans: Sequence[LabelledScan]
    weights: Singles

    def batch(self, step: int) -> list[Example]:
        """Return the examples of a step."""
        rng = generator(self.settings.seed, "segmentation", str(step))
        chosen = rng.integers(len(self.scans), size=self.settings.batch_size)
        return [self._example(self.scans[number], rng) for number in chosen.tolist()]

    def loss(self, model: SegmentationModule, batch: Sequence[Example]) -> Tensor:
        """Return the weighted cross entropy of a batch, a tensor with one number."""
        import torch
        from torch.nn import functional

        scans = [each.scan for each in batch]
        columns = torch.from_numpy(np.stack([scan.columns for scan in scans]))
        places = [torch.from_numpy(scan.places) for scan in scans]
        features = [torch.from_numpy(scan.features) for scan in scans]
        classes = torch.from_numpy(np.concatenate([each.classes for each in batch])).long()
        logits: Tensor = model(columns, places, features)
        if not len(classes):
            return logits.sum()
        return functional.cross_entropy(logits, classes, torch.from_numpy(self.weights))

    def _example(self, scan: LabelledScan, rng: np.random.Generator) -> Example:
        settings = self.settings
        kept = rng.random(len(scan.xyz)) < rng.uniform(settings.kept_share, 1)
        classes = scan.classes[kept]
        xyz = moved(scan.xyz[kept], settings, rng)
        crop = settings.replaced(cells=min(settings.crop_cells, settings.cells))
        middle = xyz[rng.integers(len(xyz)), :2] if len(xyz) else np.zeros(2)
        reach = settings.half_m - crop.half_m
        middle = np.clip(middle * rng.random(), -reach, reach)
        inside = (np.abs(xyz[:, :2] - middle) < crop.half_m).all(axis=1)
        chosen = [
            rows[random_rows(len(rows), most, rng)]
            for where, most in ((inside, settings.points), (~inside, settings.points // 16))
            for rows in [np.flatnonzero(where & (classes != IGNORED))]
        ]
        judged = np.sort(np.concatenate(chosen))
        return Example(gridded(xyz, crop, middle, judged), classes[judged])


def moved(xyz: Singles, settings: SegmentationTraining, rng: np.random.Generator) -> Singles:
    """Return points (n, 3) as another sensor at another place would have them.

    They are turned about the vertical axis, mirrored, tilted and shifted at random, and get noise.
    """
    turn = rng.uniform(0, 2 * np.pi)
    tilts = np.radians(settings.tilt_deg) * rng.uniform(-1, 1, 2)
    rotation = _about(2, turn) @ _about(0, tilts[0]) @ _about(1, tilts[1])
    if rng.random() < 0.5:
        rotation[:, 0] *= -1
    reach = np.array([settings.shift_m, settings.shift_m, settings.height_m])
    shift = reach * rng.uniform(-1, 1, 3)
    noise = rng.standard_normal(xyz.shape, np.float32) * rng.uniform(0, settings.jitter_m)
    return (xyz @ rotation.T + shift + noise).astype(np.float32)


def _about(axis: int, angle: float) -> NDArray[np.float64]:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[first, second], [first, second]] = np.cos(angle)
    rotation[first, second], rotation[second, first] = -np.sin(angle), np.sin(angle)
    return rotation


def class_weights(scans: Sequence[LabelledScan], classes: int) -> Singles:
    """Return the weight of each class in the loss, (classes,): rarer classes have larger ones.

    A weight is the inverse of the root of the class's share of all judged points, and the weights
    of all these points have the mean 1. Classes without points have weight 0.
    """
    counts = sum(
        (np.bincount(scan.classes, minlength=256)[:classes] for scan in scans), np.zeros(1)
    )
    weights = np.divide(1, np.sqrt(counts), out=np.zeros(classes), where=counts > 0)
    return np.asarray(weights * counts.sum() / (weights * counts).sum(), np.float32)
