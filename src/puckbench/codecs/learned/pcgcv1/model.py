"""The network of PCGCv1: a dense autoencoder of cubes of voxels with a hyper-prior.

Wang, Zhu, Liu, Ma: "Lossy Point Cloud Geometry Compression via End-to-End Learning", IEEE TCSVT
2021. It may have several rates: see `gains`.

Convolutions pad as TensorFlow's 'same' does: a stride of two pads one at the far end alone, and a
transposed convolution keeps the first 2 n of its 2 n + 1 outputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn.functional import linear, max_pool3d, pad

from puckbench.codecs.learned.gains import Gained
from puckbench.codecs.learned.pcgcv1.occupied_blocks import STRIDE


@dataclass(frozen=True)
class Shape:
    """Sizes of the network; the original's by default.

    side: voxels along a cube's edge, a multiple of eight. widths: features at strides 1, 2 and 4.
    latent: features coded. hyper: width of the hyper-prior's layers and features it codes.
    blocks: at each scale. rates: gains. supported: the decoder is told which blocks hold voxels.
    """

    side: int = 64
    widths: tuple[int, int, int] = (16, 32, 64)
    latent: int = 16
    hyper: tuple[int, int] = (16, 8)
    blocks: int = 3
    rates: int = 1
    supported: bool = False


class Conv(nn.Conv3d):
    """3x3x3 convolution that keeps the size."""

    def __init__(self, width: int, out: int) -> None:
        super().__init__(width, out, 3, padding=1)


class Pointwise(nn.Conv3d):
    """1x1x1 convolution; as a product of matrices, whose gradient PyTorch finds sooner."""

    def __init__(self, width: int, out: int) -> None:
        super().__init__(width, out, 1)

    def forward(self, features: Tensor) -> Tensor:
        """(n, c, s, s, s) to (n, d, s, s, s)."""
        rows = features.movedim(1, -1)
        return linear(rows, self.weight[:, :, 0, 0, 0], self.bias).movedim(-1, 1)


class Down(nn.Conv3d):
    """3x3x3 convolution of stride two: (n, c, 2 s, 2 s, 2 s) to (n, d, s, s, s)."""

    def __init__(self, width: int, out: int, bias: bool = True) -> None:
        super().__init__(width, out, 3, stride=2, bias=bias)

    def forward(self, features: Tensor) -> Tensor:
        """Pad one at the far end of each axis, then convolve."""
        return super().forward(pad(features, (0, 1) * 3))


class Up(nn.ConvTranspose3d):
    """Transposed 3x3x3 convolution of stride two: (n, c, s, s, s) to (n, d, 2 s, 2 s, 2 s)."""

    def __init__(self, width: int, out: int) -> None:
        super().__init__(width, out, 3, stride=2)

    def forward(self, features: Tensor, output_size: list[int] | None = None) -> Tensor:
        """Convolve and drop the last of each axis."""
        return super().forward(features, output_size)[:, :, :-1, :-1, :-1]


class VoxceptionResNet(nn.Module):
    """Two paths of a quarter of the width beside each other, added to the input."""

    def __init__(self, width: int) -> None:
        super().__init__()
        quarter = width // 4
        self.near_in = Conv(width, quarter)
        self.near_out = Conv(quarter, 2 * quarter)
        self.point_in = Pointwise(width, quarter)
        self.middle = Conv(quarter, quarter)
        self.point_out = Pointwise(quarter, 2 * quarter)

    def forward(self, features: Tensor) -> Tensor:
        """(n, c, s, s, s) to the same; a ReLU after every convolution and after the sum."""
        near = self.near_out(self.near_in(features).relu()).relu()
        point = self.middle(self.point_in(features).relu()).relu()
        return (features + torch.cat([near, self.point_out(point).relu()], dim=1)).relu()


def _blocks(width: int, count: int) -> nn.Sequential:
    return nn.Sequential(*(VoxceptionResNet(width) for _ in range(count)))


class Analysis(nn.Module):
    """From occupied voxels (n, 1, side, side, side) to the latent at stride 4."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        one, two, four = shape.widths
        self.first = Conv(1, one)
        self.blocks = nn.ModuleList(_blocks(width, shape.blocks) for width in shape.widths)
        self.downs = nn.ModuleList([Down(one, two, bias=False), Down(two, four, bias=False)])
        self.last = Conv(four, shape.latent)

    def forward(self, occupied: Tensor) -> Tensor:
        """Ones and zeros to the latent, not yet rounded."""
        features = self.blocks[0](self.first(occupied).relu())
        for down, blocks in zip(self.downs, self.blocks[1:], strict=True):
            features = blocks(down(features).relu())
        return cast(Tensor, self.last(features))


class Synthesis(nn.Module):
    """From the latent to a logit of occupancy for every voxel (n, 1, side, side, side)."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        one, two, four = shape.widths
        self.first = Conv(shape.latent, four)
        self.blocks = nn.ModuleList(_blocks(width, shape.blocks) for width in (four, two, one))
        self.ups = nn.ModuleList([Up(four, two), Up(two, one)])
        self.last = Conv(one, 1)

    def forward(self, latent: Tensor) -> Tensor:
        """The latent, rounded or with noise, to logits."""
        features = self.blocks[0](self.first(latent).relu())
        for up, blocks in zip(self.ups, self.blocks[1:], strict=True):
            features = blocks(up(features).relu())
        return cast(Tensor, self.last(features))


class HyperEncoder(nn.Module):
    """From the latent to the hyper-latent at stride 8."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        width, coded = shape.hyper
        self.first = Conv(shape.latent, width)
        self.down = Down(width, width)
        self.last = Conv(width, coded)

    def forward(self, latent: Tensor) -> Tensor:
        """(n, latent, s, s, s) to (n, hyper, s / 2, s / 2, s / 2)."""
        return cast(Tensor, self.last(self.down(self.first(latent).relu()).relu()))


class Laplacians(NamedTuple):
    """Location and scale of each value of the latent, (n, latent, s, s, s) each."""

    location: Tensor
    scale: Tensor


class HyperDecoder(nn.Module):
    """From the hyper-latent to the latent's distributions."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        width, coded = shape.hyper
        self.first = Conv(coded, width)
        self.up = Up(width, width)
        self.wide = Conv(width, 2 * width)
        self.location = Conv(2 * width, shape.latent)
        self.scale = Conv(2 * width, shape.latent)

    def forward(self, hyper: Tensor) -> Laplacians:
        """(n, hyper, s / 2, s / 2, s / 2) to the distributions of (n, latent, s, s, s)."""
        features = self.wide(self.up(self.first(hyper).relu()).relu()).relu()
        return Laplacians(self.location(features), self.scale(features).abs())


class PCGCv1(Gained):
    """The four networks, and for each rate a bottleneck of the hyper-latent and gains."""

    shape: Shape

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        self.analysis, self.synthesis = Analysis(shape), Synthesis(shape)
        self.hyper_encoder, self.hyper_decoder = HyperEncoder(shape), HyperDecoder(shape)
        self.add_rates(shape, shape.hyper[1])

    def gain(self, rate: int) -> Tensor:
        """What the latent is multiplied by, (latent, 1, 1, 1); ones where there is one rate."""
        return super().gain(rate)[:, None, None, None]


def held(shape: Shape, occupied: Tensor) -> Tensor:
    """Ones in the blocks (n, 1, s, s, s) whose latent is coded, zeros elsewhere.

    occupied: cubes of zeros and ones (n, 1, side, side, side).
    """
    blocks = max_pool3d(occupied, STRIDE)
    return blocks if shape.supported else torch.ones_like(blocks)
