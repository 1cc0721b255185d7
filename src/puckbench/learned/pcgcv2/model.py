"""The network of PCGCv2: a sparse-convolution autoencoder with three scales.

Transforms are named as in learned compression: the analysis transform g_a makes the latent y, the
synthesis transform g_s decodes it. The network may code at several rates (see `gains`).

References
----------
Wang, Ding, Li, Ma: "Multiscale Point Cloud Geometry Compression", DCC 2021, section 3 and figure 1;
layers are named as in the authors' program.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, cast

import torch
from pydantic import Field
from torch import Tensor, nn

from puckbench.core.models import Model
from puckbench.learned.gains import MultiRateNetwork
from puckbench.learned.sparse.convolution import Neighbourhood
from puckbench.learned.sparse.layers import (
    GenerativeTransposedConvolution,
    PointwiseConvolution,
    SparseConvolution,
    StridedConvolution,
)
from puckbench.learned.sparse.voxels import ChildMap

SCALES = 3
_Channels = Annotated[int, Field(ge=1, le=1024)]
_Few = Annotated[int, Field(ge=1, le=64)]


class Pcgcv2Shape(Model):
    """Sizes of the network, by default those of the paper.

    Parameters
    ----------
    channels
        Of the features of g_a at strides 1, 2, 4 and 8; g_s has the first three backwards.
    latent_channels
        Channels of the latent y.
    blocks
        Inception-ResNet blocks of each scale.
    rates
        Rates that share the weights.
    """

    channels: tuple[_Channels, _Channels, _Channels, _Channels] = (16, 32, 64, 32)
    latent_channels: _Channels = 8
    blocks: _Few = 3
    rates: _Few = 1


class InceptionResNet(nn.Module):
    """Inception-ResNet block: two branches of a quarter of the channels, added to the input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        quarter = channels // 4
        self.conv0_0 = SparseConvolution(channels, quarter)
        self.conv0_1 = SparseConvolution(quarter, 2 * quarter)
        self.conv1_0 = PointwiseConvolution(channels, quarter)
        self.conv1_1 = SparseConvolution(quarter, quarter)
        self.conv1_2 = PointwiseConvolution(quarter, 2 * quarter)

    def forward(self, features: Tensor, where: Neighbourhood) -> Tensor:
        """Features (n, children, c) to features of the same shape."""
        out0 = self.conv0_1(self.conv0_0(features, where).relu(), where)
        out1 = self.conv1_1(self.conv1_0(features).relu(), where).relu()
        return features + torch.cat([out0, self.conv1_2(out1)], dim=2)


class InceptionResNetBlocks(nn.ModuleList):
    """Inception-ResNet blocks, one after the other."""

    def __init__(self, channels: int, count: int) -> None:
        super().__init__(InceptionResNet(channels) for _ in range(count))

    def __iter__(self) -> Iterator[InceptionResNet]:
        return cast(Iterator[InceptionResNet], super().__iter__())

    def forward(self, features: Tensor, where: Neighbourhood) -> Tensor:
        """Features (n, children, c) to features of the same shape."""
        for block in self:
            features = block(features, where)
        return features


class AnalysisScale(nn.Module):
    """One scale of g_a, from a set of voxels to the next coarser one."""

    def __init__(self, channels: int, inner: int, out: int, blocks: int) -> None:
        super().__init__()
        self.down = StridedConvolution(channels, inner)
        self.blocks = InceptionResNetBlocks(inner, blocks)
        self.conv = SparseConvolution(inner, out)

    def forward(self, features: Tensor, child_map: ChildMap, where: Neighbourhood) -> Tensor:
        """Features (n, 1, c) to (m, 1, d) of the parents, before the ReLU."""
        features = self.blocks(self.down(features, child_map).relu(), where)
        result: Tensor = self.conv(features, where)
        return result


class Pcgcv2Analysis(nn.Module):
    """Analysis transform g_a: from occupied voxels to the latent y at stride 8."""

    def __init__(self, shape: Pcgcv2Shape) -> None:
        super().__init__()
        channels = shape.channels
        outs = [*channels[1:-1], shape.latent_channels]
        self.conv0 = SparseConvolution(1, channels[0])
        self.scales = nn.ModuleList(
            AnalysisScale(*sizes, shape.blocks)
            for sizes in zip(channels, channels[1:], outs, strict=False)
        )

    def scale(self, scale: int) -> AnalysisScale:
        """The layers from stride ``2**scale`` to the next."""
        return cast(AnalysisScale, self.scales[scale])

    def forward(
        self, sites: list[Neighbourhood], child_maps: list[ChildMap], features: Tensor
    ) -> Tensor:
        """Ones (n, 1, 1) to y (m, 1, latent_channels), with the voxels at strides 1, 2, 4, 8."""
        features = self.conv0(features, sites[0])
        for scale in range(SCALES):
            features = self.scale(scale)(features.relu(), child_maps[scale], sites[scale + 1])
        return features


class SynthesisScale(nn.Module):
    """One scale of g_s, from a set of voxels to all their children and logits of occupancy."""

    def __init__(self, channels: int, inner: int, blocks: int) -> None:
        super().__init__()
        self.up = GenerativeTransposedConvolution(channels, inner)
        self.conv = SparseConvolution(inner, inner)
        self.blocks = InceptionResNetBlocks(inner, blocks)
        self.conv_cls = SparseConvolution(inner, 1)

    def forward(self, features: Tensor, where: Neighbourhood) -> tuple[Tensor, Tensor]:
        """Features (m, c) of parents to those of their children (m, 8, d) and logits (m, 8)."""
        children = self.conv(self.up(features).relu(), where).relu()
        children = self.blocks(children, where)
        return children, self.conv_cls(children, where)[:, :, 0]


class Pcgcv2Synthesis(nn.Module):
    """Synthesis transform g_s: from the latent at stride 8 to occupancy, scale by scale."""

    def __init__(self, shape: Pcgcv2Shape) -> None:
        super().__init__()
        channels = (shape.latent_channels, *shape.channels[2::-1])
        self.scales = nn.ModuleList(
            SynthesisScale(*sizes, shape.blocks) for sizes in pairwise(channels)
        )

    def scale(self, scale: int) -> SynthesisScale:
        """The layers to strides 4, 2 and 1, for scales 0, 1 and 2."""
        return cast(SynthesisScale, self.scales[scale])


class PCGCv2(MultiRateNetwork):
    """Transforms g_a and g_s, and for each rate an entropy bottleneck and gains of y."""

    shape: Pcgcv2Shape

    def __init__(self, shape: Pcgcv2Shape) -> None:
        super().__init__(shape)
        self.g_a = Pcgcv2Analysis(shape)
        self.g_s = Pcgcv2Synthesis(shape)
        self.add_rates(shape.latent_channels)
