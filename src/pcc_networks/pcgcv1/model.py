"""The network of PCGCv1: a dense autoencoder of cubes of voxels with a hyper-prior.

The network follows section III and figure 5 of the paper (see `pcc_networks.pcgcv1`); layers
have the authors' names. Gains are not in the paper (see `gains`).

Padding is TensorFlow's 'same': a convolution of stride two pads one voxel at the far end only; a
transposed convolution keeps the first 2 n of its 2 n + 1 outputs.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, NamedTuple, cast

import torch
from pydantic import Field
from torch import Tensor, nn
from torch.nn.functional import linear, max_pool3d, pad

from pcc_networks.gains import MultiRateNetwork
from pcc_networks.pcgcv1.cubes import STRIDE
from pointkit.models import Model

_Channels = Annotated[int, Field(ge=1, le=1024)]
_Few = Annotated[int, Field(ge=1, le=64)]


class Pcgcv1Shape(Model):
    """Sizes of the network PCGCv1, by default those of the paper."""

    # voxels along an edge of a cube
    cube_size: Annotated[int, Field(ge=8, le=256, multiple_of=8)] = 64
    channels: tuple[_Channels, _Channels, _Channels] = (16, 32, 64)  # at strides 1, 2 and 4
    latent_channels: _Channels = 16
    # of the layers of h_a and h_s, and of the hyper-latent z
    hyper_channels: tuple[_Channels, _Channels] = (16, 8)
    blocks: _Few = 3  # Voxception-ResNet blocks of each scale
    rates: _Few = 1  # that share the weights
    occupied_blocks: bool = False  # the decoder knows which blocks of 4x4x4 voxels are occupied


class Conv(nn.Conv3d):
    def __init__(self, channels: int, out: int) -> None:
        super().__init__(channels, out, 3, padding=1)


class PointwiseConv(nn.Conv3d):
    """1x1x1 convolution as a matrix product, whose gradient PyTorch computes faster."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__(channels, out, 1)

    def forward(self, features: Tensor) -> Tensor:
        rows = features.movedim(1, -1)
        return linear(rows, self.weight[:, :, 0, 0, 0], self.bias).movedim(-1, 1)


class StridedConv(nn.Conv3d):
    """3x3x3 convolution of stride two: (n, c, 2 s, 2 s, 2 s) to (n, d, s, s, s)."""

    def __init__(self, channels: int, out: int, bias: bool = True) -> None:
        super().__init__(channels, out, 3, stride=2, bias=bias)

    def forward(self, features: Tensor) -> Tensor:
        return super().forward(pad(features, (0, 1) * 3))


class TransposedConv(nn.ConvTranspose3d):
    """Transposed 3x3x3 convolution of stride two: (n, c, s, s, s) to (n, d, 2 s, 2 s, 2 s)."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__(channels, out, 3, stride=2)

    def forward(self, features: Tensor, output_size: list[int] | None = None) -> Tensor:
        return super().forward(features, output_size)[:, :, :-1, :-1, :-1]


class VoxceptionResNet(nn.Module):
    """Voxception-ResNet block: two branches of half the channels, added to the input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        quarter = channels // 4
        self.conv1_1 = Conv(channels, quarter)
        self.conv1_2 = Conv(quarter, 2 * quarter)
        self.conv2_1 = PointwiseConv(channels, quarter)
        self.conv2_2 = Conv(quarter, quarter)
        self.conv2_3 = PointwiseConv(quarter, 2 * quarter)

    def forward(self, features: Tensor) -> Tensor:
        out1 = self.conv1_2(self.conv1_1(features).relu()).relu()
        out2 = self.conv2_2(self.conv2_1(features).relu()).relu()
        return (features + torch.cat([out1, self.conv2_3(out2).relu()], dim=1)).relu()


def _blocks(channels: int, count: int) -> nn.Sequential:
    return nn.Sequential(*(VoxceptionResNet(channels) for _ in range(count)))


class Pcgcv1Analysis(nn.Module):
    """Analysis transform g_a from occupancy to the latent y at stride 4."""

    def __init__(self, shape: Pcgcv1Shape) -> None:
        super().__init__()
        self.conv_in = Conv(1, shape.channels[0])
        self.blocks = nn.ModuleList(_blocks(channels, shape.blocks) for channels in shape.channels)
        self.downs = nn.ModuleList(
            StridedConv(*channels, bias=False) for channels in pairwise(shape.channels)
        )
        self.conv_out = Conv(shape.channels[-1], shape.latent_channels)

    def forward(self, x: Tensor) -> Tensor:
        return _transformed(self, x, self.downs)


class Pcgcv1Synthesis(nn.Module):
    """Synthesis transform g_s from y_hat to an occupancy logit of each voxel."""

    def __init__(self, shape: Pcgcv1Shape) -> None:
        super().__init__()
        self.conv_in = Conv(shape.latent_channels, shape.channels[-1])
        outwards = shape.channels[::-1]
        self.blocks = nn.ModuleList(_blocks(channels, shape.blocks) for channels in outwards)
        self.ups = nn.ModuleList(TransposedConv(*channels) for channels in pairwise(outwards))
        self.conv_out = Conv(shape.channels[0], 1)

    def forward(self, y_hat: Tensor) -> Tensor:
        return _transformed(self, y_hat, self.ups)


def _transformed(
    network: Pcgcv1Analysis | Pcgcv1Synthesis, features: Tensor, resampling: nn.ModuleList
) -> Tensor:
    features = network.blocks[0](network.conv_in(features).relu())
    for layer, blocks in zip(resampling, network.blocks[1:], strict=True):
        features = blocks(layer(features).relu())
    return cast(Tensor, network.conv_out(features))


class HyperAnalysis(nn.Module):
    """Hyper-analysis transform h_a from the latent y to the hyper-latent z at stride 8."""

    def __init__(self, shape: Pcgcv1Shape) -> None:
        super().__init__()
        channels, hyper_latent_channels = shape.hyper_channels
        self.conv1 = Conv(shape.latent_channels, channels)
        self.conv2 = StridedConv(channels, channels)
        self.conv3 = Conv(channels, hyper_latent_channels)

    def forward(self, y: Tensor) -> Tensor:
        return cast(Tensor, self.conv3(self.conv2(self.conv1(y).relu()).relu()))


class LaplaceParameters(NamedTuple):
    """Location and scale of the distribution of each value of y, (n, c, s, s, s) each."""

    location: Tensor
    scale: Tensor


class HyperSynthesis(nn.Module):
    """Hyper-synthesis transform h_s from z_hat to the distributions of y."""

    def __init__(self, shape: Pcgcv1Shape) -> None:
        super().__init__()
        channels, hyper_latent_channels = shape.hyper_channels
        self.conv1 = Conv(hyper_latent_channels, channels)
        self.conv2 = TransposedConv(channels, channels)
        self.conv3 = Conv(channels, 2 * channels)
        self.location = Conv(2 * channels, shape.latent_channels)
        self.scale = Conv(2 * channels, shape.latent_channels)

    def forward(self, z_hat: Tensor) -> LaplaceParameters:
        features = self.conv3(self.conv2(self.conv1(z_hat).relu()).relu()).relu()
        return LaplaceParameters(self.location(features), self.scale(features).abs())


class Latents(NamedTuple):
    y: Tensor
    z: Tensor
    blocks: Tensor  # ones where y is coded, else zeros
    hyper_blocks: Tensor  # ones where z is coded, else zeros


class PCGCv1(MultiRateNetwork):
    """The network PCGCv1, a PyTorch module with the parameters of one or several rates.

    It has transforms g_a from a cube's occupancy to the latent y, g_s back, h_a from y to the
    hyper-latent z, and h_s from z to the distributions of y; for each rate, gains of y and an
    entropy bottleneck of z.
    """

    Shape = Pcgcv1Shape
    shape: Pcgcv1Shape

    def __init__(self, shape: Pcgcv1Shape) -> None:
        super().__init__(shape)
        self.g_a, self.g_s = Pcgcv1Analysis(shape), Pcgcv1Synthesis(shape)
        self.h_a, self.h_s = HyperAnalysis(shape), HyperSynthesis(shape)
        self.add_rates(shape.hyper_channels[1])

    def gain(self, rate: int) -> Tensor:
        return super().gain(rate)[:, None, None, None]

    def latents(self, x: Tensor, rate: int) -> Latents:
        """Transform cubes x (n, 1, size, size, size) to y, times the gains of a rate, and z."""
        blocks = coded_blocks(self.shape, x)
        hyper_blocks = max_pool3d(blocks, 2)
        y = self.g_a(x) * self.gain(rate) * blocks
        return Latents(y, self.h_a(y) * hyper_blocks, blocks, hyper_blocks)


def coded_blocks(shape: Pcgcv1Shape, x: Tensor) -> Tensor:
    """Return ones where the latent of cubes x (n, 1, size, size, size) is coded, else zeros."""
    blocks = max_pool3d(x, STRIDE)
    return blocks if shape.occupied_blocks else torch.ones_like(blocks)
