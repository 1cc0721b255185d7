"""The network: a U-Net of 2D convolutions over the grid, and a perceptron for each point."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from itertools import pairwise
from typing import Annotated

import torch
from pydantic import Field, StringConstraints
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils import fuse_conv_bn_eval

from lidar_segmentation.grid import HEIGHTS, OFFSETS, GridShape

Channels = Annotated[int, Field(ge=1, le=256)]
ClassName = Annotated[str, StringConstraints(min_length=1, max_length=40)]


class NetworkShape(GridShape):
    """Sizes of the network and of its grid.

    Parameters
    ----------
    classes
        Names of the classes.
    channels
        Channels at each stride of the U-Net: 1, 2, 4 and 8 cells.
    hidden
        Width of the perceptron for each point.
    """

    classes: Annotated[tuple[ClassName, ...], Field(min_length=2, max_length=200)]
    channels: tuple[Channels, Channels, Channels, Channels] = (24, 32, 48, 64)
    hidden: Channels = 64


class Convolution(nn.Module):
    """A convolution of 3 x 3 cells, its normalisation while it is trained, and a ReLU."""

    def __init__(self, before: int, after: int, stride: int = 1, dilation: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(
            before, after, 3, stride=stride, padding=dilation, dilation=dilation, bias=False
        )
        self.norm: nn.Module = nn.BatchNorm2d(after)

    def forward(self, x: Tensor) -> Tensor:
        """Return the output (b, after, rows, columns) for an input (b, before, ...)."""
        result: Tensor = functional.relu(self.norm(self.conv(x)))
        return result

    def fuse(self) -> None:
        """Make the normalisation a part of the convolution, whose output stays the same."""
        if isinstance(self.norm, nn.BatchNorm2d):
            self.conv = fuse_conv_bn_eval(self.conv.eval(), self.norm.eval())
            self.norm = nn.Identity()


class SegmentationModule(nn.Module):
    """The network as a PyTorch module.

    Parameters
    ----------
    shape
        Sizes of the network.
    """

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.shape = shape
        wide = shape.channels
        self.first = Convolution(shape.bins + HEIGHTS, wide[0])
        self.down = nn.ModuleList(
            nn.Sequential(Convolution(before, after, stride=2), Convolution(after, after))
            for before, after in pairwise(wide)
        )
        self.around = nn.Sequential(*(Convolution(wide[-1], wide[-1], dilation=2) for _ in "12"))
        self.narrow = nn.ModuleList(
            nn.Conv2d(before, after, 1)
            for before, after in zip(wide[:0:-1], wide[-2::-1], strict=True)
        )
        self.up = nn.ModuleList(Convolution(after, after) for after in wide[-2::-1])
        self.points = nn.Sequential(
            nn.Linear(wide[0] + shape.bins + OFFSETS, shape.hidden),
            nn.ReLU(),
            nn.Linear(shape.hidden, shape.hidden),
            nn.ReLU(),
            nn.Linear(shape.hidden, len(shape.classes)),
        )

    def cells(self, columns: Tensor) -> Tensor:
        """Return features (b, channels[0], cells, cells) of the cells of b grids."""
        skipped = [self.first(columns)]
        for down in self.down:
            skipped.append(down(skipped[-1]))
        x: Tensor = skipped.pop()
        x = x + self.around(x)
        for narrow, up in zip(self.narrow, self.up, strict=True):
            wider = functional.interpolate(narrow(x), scale_factor=2, mode="nearest")
            x = up(wider + skipped.pop())
        return x

    def forward(
        self, columns: Tensor, places: Sequence[Tensor], features: Sequence[Tensor]
    ) -> Tensor:
        """Return the logits (n, classes) of the points of a batch of scans, one after the other.

        Parameters
        ----------
        columns
            Channels of the cells (b, bins + `HEIGHTS`, cells, cells).
        places, features
            `Gridded.places` and `Gridded.features` of the points of each scan.
        """
        return self.classified(self.cells(columns), places, features)

    def classified(
        self, cells: Tensor, places: Sequence[Tensor], features: Sequence[Tensor]
    ) -> Tensor:
        """Return the logits of points as `forward` does, from the features of the cells."""
        sampled = [
            functional.grid_sample(scan[None], where[None, None], align_corners=False)[0, :, 0].T
            for scan, where in zip(cells, places, strict=True)
        ]
        inputs = torch.cat([torch.cat(sampled), torch.cat(list(features))], dim=1)
        logits: Tensor = self.points(inputs)
        return logits


def fused(model: SegmentationModule) -> SegmentationModule:
    """Return a copy of a module that is ready to predict: its normalisations are in its weights."""
    copied = deepcopy(model).eval()
    for part in copied.modules():
        if isinstance(part, Convolution):
            part.fuse()
    return copied.requires_grad_(False)
