"""The network of PCGCv2: a sparse-convolution autoencoder with three scales.

Wang, Ding, Li, Ma: "Multiscale Point Cloud Geometry Compression", DCC 2021. It may have several
rates: see `gains`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import torch
from torch import Tensor, nn

from puckbench.codecs.learned.gains import Gained
from puckbench.codecs.learned.sparse.convolution import Site
from puckbench.codecs.learned.sparse.layers import Convolution, Down, Pointwise, Up
from puckbench.codecs.learned.sparse.voxels import Families

SCALES = 3


@dataclass(frozen=True)
class Shape:
    """Sizes of the network; the original's by default.

    widths: features at strides 1, 2, 4 and 8 of the encoder; the decoder's, at strides 4, 2 and 1,
    are the middle ones backwards. latent: features coded. blocks: at each scale. rates: gains.
    """

    widths: tuple[int, int, int, int] = (16, 32, 64, 32)
    latent: int = 8
    blocks: int = 3
    rates: int = 1


class InceptionResidual(nn.Module):
    """Two paths of a quarter of the width beside each other, added to the input."""

    def __init__(self, width: int) -> None:
        super().__init__()
        quarter = width // 4
        self.near_in = Convolution(width, quarter)
        self.near_out = Convolution(quarter, 2 * quarter)
        self.point_in = Pointwise(width, quarter)
        self.middle = Convolution(quarter, quarter)
        self.point_out = Pointwise(quarter, 2 * quarter)

    def forward(self, features: Tensor, where: Site) -> Tensor:
        """(n, children, c) to the same."""
        near = self.near_out(self.near_in(features, where).relu(), where)
        point = self.middle(self.point_in(features).relu(), where).relu()
        return features + torch.cat([near, self.point_out(point)], dim=2)


class Blocks(nn.ModuleList):
    """Blocks one after the other."""

    def __init__(self, width: int, count: int) -> None:
        super().__init__(InceptionResidual(width) for _ in range(count))

    def __iter__(self) -> Iterator[InceptionResidual]:
        return cast(Iterator[InceptionResidual], super().__iter__())

    def forward(self, features: Tensor, where: Site) -> Tensor:
        """(n, children, c) to the same."""
        for block in self:
            features = block(features, where)
        return features


class EncoderScale(nn.Module):
    """From a set of voxels to the next coarser one."""

    def __init__(self, width: int, wider: int, end: int, blocks: int) -> None:
        super().__init__()
        self.down = Down(width, wider)
        self.blocks = Blocks(wider, blocks)
        self.conv = Convolution(wider, end)

    def forward(self, features: Tensor, families: Families, where: Site) -> Tensor:
        """(n, 1, c) to (m, 1, d), before the ReLU."""
        features = self.blocks(self.down(features, families).relu(), where)
        result: Tensor = self.conv(features, where)
        return result


class Encoder(nn.Module):
    """From occupied voxels to features of the voxels at stride 8."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        widths = shape.widths
        ends = [*widths[1:-1], shape.latent]
        self.first = Convolution(1, widths[0])
        self.scales = nn.ModuleList(
            EncoderScale(*steps, shape.blocks)
            for steps in zip(widths, widths[1:], ends, strict=False)
        )

    def scale(self, scale: int) -> EncoderScale:
        """The layers from stride ``2**scale`` to the next."""
        return cast(EncoderScale, self.scales[scale])

    def forward(self, sites: list[Site], families: list[Families], features: Tensor) -> Tensor:
        """Ones (n, 1, 1) to the latent (m, 1, latent); sites of strides 1, 2, 4, 8, in rows."""
        features = self.first(features, sites[0])
        for scale in range(SCALES):
            features = self.scale(scale)(features.relu(), families[scale], sites[scale + 1])
        return features


class DecoderScale(nn.Module):
    """From a set of voxels to all their children, with a logit of occupancy for each."""

    def __init__(self, width: int, wider: int, blocks: int) -> None:
        super().__init__()
        self.up = Up(width, wider)
        self.conv = Convolution(wider, wider)
        self.blocks = Blocks(wider, blocks)
        self.logits = Convolution(wider, 1)

    def forward(self, features: Tensor, where: Site) -> tuple[Tensor, Tensor]:
        """Features (m, c) of parents to those of their children (m, 8, d) and logits (m, 8)."""
        children = self.conv(self.up(features).relu(), where).relu()
        children = self.blocks(children, where)
        return children, self.logits(children, where)[:, :, 0]


class Decoder(nn.Module):
    """From features at stride 8 to occupancy, scale by scale."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        widths = (shape.latent, *shape.widths[2::-1])
        self.scales = nn.ModuleList(
            DecoderScale(*steps, shape.blocks) for steps in pairwise(widths)
        )

    def scale(self, scale: int) -> DecoderScale:
        """The layers to strides 4, 2 and 1, for scales 0, 1 and 2."""
        return cast(DecoderScale, self.scales[scale])


class PCGCv2(Gained):
    """Encoder, decoder, and for each rate a bottleneck and gains of the latent."""

    shape: Shape

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        self.encoder = Encoder(shape)
        self.decoder = Decoder(shape)
        self.add_rates(shape, shape.latent)
