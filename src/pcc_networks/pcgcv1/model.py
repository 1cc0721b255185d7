"""The network of PCGCv1, a dense autoencoder of cubes of voxels with a hyper-prior.

The network follows section III and figure 5 of the paper (see `pcc_networks.pcgcv1`). Layers have
the names that the authors gave them. Gains are not in the paper (see `gains`).

Padding is TensorFlow's 'same'. A convolution of stride two pads one voxel, at the far end. A
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
    """A 3x3x3 convolution that keeps the size."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__(channels, out, 3, padding=1)


class PointwiseConv(nn.Conv3d):
    """A 1x1x1 convolution as a matrix product, whose gradient PyTorch computes faster."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__(channels, out, 1)

    def forward(self, features: Tensor) -> Tensor:
        rows = features.movedim(1, -1)
        return linear(rows, self.weight[:, :, 0, 0, 0], self.bias).movedim(-1, 1)


class StridedConv(nn.Conv3d):
    """A 3x3x3 convolution of stride two: (n, c, 2 s, 2 s, 2 s) to (n, d, s, s, s)."""

    def __init__(self, channels: int, out: int, bias: bool = True) -> None:
        super().__init__(channels, out, 3, stride=2, bias=bias)

    def forward(self, features: Tensor) -> Tensor:
        return super().forward(pad(features, (0, 1) * 3))


class TransposedConv(nn.ConvTranspose3d):
    """A transposed 3x3x3 convolution of stride two: (n, c, s, s, s) to (n, d, 2 s, 2 s, 2 s)."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__(channels, out, 3, stride=2)

    def forward(self, features: Tensor, output_size: list[int] | None = None) -> Tensor:
        return super().forward(features, output_size)[:, :, :-1, :-1, :-1]


class VoxceptionResNet(nn.Module):
    """A Voxception-ResNet block, which adds two branches of half the channels to its input."""

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
    """The analysis transform g_a, which computes the latent y at stride 4 from occupancy."""

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
    """The synthesis transform g_s, which computes each voxel's occupancy logit from y_hat."""

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
    """The hyper-analysis transform h_a, which computes the hyper-latent z at stride 8 from y."""

    def __init__(self, shape: Pcgcv1Shape) -> None:
        super().__init__()
        channels, hyper_latent_channels = shape.hyper_channels
        self.conv1 = Conv(shape.latent_channels, channels)
        self.conv2 = StridedConv(channels, channels)
        self.conv3 = Conv(channels, hyper_latent_channels)

    def forward(self, y: Tensor) -> Tensor:
        return cast(Tensor, self.conv3(self.conv2(self.conv1(y).relu()).relu()))


class LaplaceParameters(NamedTuple):
    """Location and scale of the distribution of each value of y, both (n, c, s, s, s)."""

    location: Tensor
    scale: Tensor


class HyperSynthesis(nn.Module):
    """The hyper-synthesis transform h_s, which computes the distributions of y from z_hat."""

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
    """The latent y and the hyper-latent z of cubes, and where they are coded."""

    y: Tensor
    z: Tensor
    blocks: Tensor  # ones where y is coded, else zeros
    hyper_blocks: Tensor  # ones where z is coded, else zeros


class PCGCv1(MultiRateNetwork):
    """The network PCGCv1, a PyTorch module with the parameters of one or several rates.

    It consists of four transforms. g_a computes the latent y from the occupancy of a cube, and g_s
    computes occupancy from y. h_a computes the hyper-latent z from y, and h_s computes the
    distributions of y from z. Each rate has gains of y and an entropy bottleneck of z.
    """

    Shape = Pcgcv1Shape
    shape: Pcgcv1Shape

    def __init__(self, shape: Pcgcv1Shape) -> None:
        super().__init__(shape)
        self.g_a, self.g_s = Pcgcv1Analysis(shape), Pcgcv1Synthesis(shape)
        self.h_a, self.h_s = HyperAnalysis(shape), HyperSynthesis(shape)
        self.add_rates(shape.hyper_channels[1])

    def gain(self, rate: int) -> Tensor:
        """Return the factors of the latent at the rate with this index, (channels, 1, 1, 1)."""
        return super().gain(rate)[:, None, None, None]

    def latents(self, x: Tensor, rate: int) -> Latents:
        """Compute the latents of cubes.

        Parameters
        ----------
        x
            Occupancy (n, 1, size, size, size) of the cubes, 0 or 1.
        rate
            Index of the rate, by whose gains y is multiplied.
        """
        blocks = coded_blocks(self.shape, x)
        hyper_blocks = max_pool3d(blocks, 2)
        y = self.g_a(x) * self.gain(rate) * blocks
        return Latents(y, self.h_a(y) * hyper_blocks, blocks, hyper_blocks)


def coded_blocks(shape: Pcgcv1Shape, x: Tensor) -> Tensor:
    """Return 1 where the latent of cubes is coded, else 0.

    The occupancy `x` has the shape (n, 1, size, size, size), the result (n, 1, s, s, s).
    """
    blocks = max_pool3d(x, STRIDE)
    return blocks if shape.occupied_blocks else torch.ones_like(blocks)
