"""The network of PCGCv2, an autoencoder of sparse convolutions with three scales.

The network follows section 3 and figure 1 of the paper (see `pcc_networks.pcgcv2`). Layers have the
names that the authors gave them. Gains are not in the paper (see `gains`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, cast

import torch
from pydantic import Field
from torch import Tensor, nn

from pcc_networks.gains import MultiRateNetwork
from pcc_networks.sparse.convolution import (
    GenerativeTransposedConvolution,
    Neighbourhood,
    PointwiseConvolution,
    SparseConvolution,
    StridedConvolution,
    neighbourhood_of,
)
from pcc_networks.sparse.gather_scatter import block_kernel_map, voxel_kernel_map
from pcc_networks.sparse.thread_pool import ThreadPool
from pcc_networks.sparse.voxels import ChildMap, VoxelSet
from pointkit.models import Model

SCALES = 3
_Channels = Annotated[int, Field(ge=1, le=1024)]
_Few = Annotated[int, Field(ge=1, le=64)]


class Pcgcv2Shape(Model):
    """Sizes of the network PCGCv2, by default those of the paper."""

    # of g_a at strides 1, 2, 4 and 8; g_s has the first three in reverse
    channels: tuple[_Channels, _Channels, _Channels, _Channels] = (16, 32, 64, 32)
    latent_channels: _Channels = 8
    blocks: _Few = 3  # Inception-ResNet blocks of each scale
    rates: _Few = 1  # that share the weights


class InceptionResNet(nn.Module):
    """An Inception-ResNet block, which adds two branches to its input features (n, children, c)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        quarter = channels // 4
        self.conv0_0 = SparseConvolution(channels, quarter)
        self.conv0_1 = SparseConvolution(quarter, 2 * quarter)
        self.conv1_0 = PointwiseConvolution(channels, quarter)
        self.conv1_1 = SparseConvolution(quarter, quarter)
        self.conv1_2 = PointwiseConvolution(quarter, 2 * quarter)

    def forward(self, features: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        out0 = self.conv0_1(self.conv0_0(features, neighbourhood).relu(), neighbourhood)
        out1 = self.conv1_1(self.conv1_0(features).relu(), neighbourhood).relu()
        return features + torch.cat([out0, self.conv1_2(out1)], dim=2)


class InceptionResNetBlocks(nn.ModuleList):
    """A sequence of Inception-ResNet blocks."""

    def __init__(self, channels: int, count: int) -> None:
        super().__init__(InceptionResNet(channels) for _ in range(count))

    def __iter__(self) -> Iterator[InceptionResNet]:
        return cast(Iterator[InceptionResNet], super().__iter__())

    def forward(self, features: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        for block in self:
            features = block(features, neighbourhood)
        return features


class AnalysisScale(nn.Module):
    """One scale of the analysis transform, which halves the resolution."""

    def __init__(self, channels: int, inner: int, out: int, blocks: int) -> None:
        super().__init__()
        self.down = StridedConvolution(channels, inner)
        self.blocks = InceptionResNetBlocks(inner, blocks)
        self.conv = SparseConvolution(inner, out)

    def forward(
        self, features: Tensor, child_map: ChildMap, neighbourhood: Neighbourhood
    ) -> Tensor:
        features = self.blocks(self.down(features, child_map).relu(), neighbourhood)
        result: Tensor = self.conv(features, neighbourhood)
        return result


class Pcgcv2Analysis(nn.Module):
    """The analysis transform g_a, which computes the latent y at stride 8 from occupied voxels."""

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
        """Return the layers of a scale, of which 0 is the finest."""
        return cast(AnalysisScale, self.scales[scale])

    def forward(
        self, sets: Sequence[VoxelSet], child_maps: Sequence[ChildMap], pool: ThreadPool
    ) -> Tensor:
        """Return the latent y (m, latent_channels) of a cloud.

        Parameters
        ----------
        sets, child_maps
            Voxels of strides 1, 2, 4 and 8, and the maps between them, from `pyramid`.
        pool
            Threads of the convolutions.
        """
        kernel = self.conv0.kernel
        around = [
            neighbourhood_of(voxels.neighbours, voxel_kernel_map(), pool, kernel.device)
            for voxels in sets
        ]
        features: Tensor = self.conv0(kernel.new_ones(len(sets[0]), 1, 1), around[0])
        for scale in range(SCALES):
            features = self.scale(scale)(features.relu(), child_maps[scale], around[scale + 1])
        return features[:, 0]


class SynthesisScale(nn.Module):
    """One scale of the synthesis transform, which doubles the resolution."""

    def __init__(self, channels: int, inner: int, blocks: int) -> None:
        super().__init__()
        self.up = GenerativeTransposedConvolution(channels, inner)
        self.conv = SparseConvolution(inner, inner)
        self.blocks = InceptionResNetBlocks(inner, blocks)
        self.conv_cls = SparseConvolution(inner, 1)

    def forward(
        self, features: Tensor, parents: VoxelSet, pool: ThreadPool
    ) -> tuple[Tensor, Tensor]:
        """Compute features and occupancy of all children of voxels.

        Parameters
        ----------
        features
            Features (m, c) of the parents.
        parents
            The parents.
        pool
            Threads of the convolutions.

        Returns
        -------
        features
            Features (m, 8, d) of the children.
        logits
            Logits (m, 8) of the occupancy of the children.
        """
        table, kernel_map = parents.neighbours, block_kernel_map()
        neighbourhood = neighbourhood_of(table, kernel_map, pool, features.device)
        children = self.conv(self.up(features).relu(), neighbourhood).relu()
        children = self.blocks(children, neighbourhood)
        return children, self.conv_cls(children, neighbourhood)[:, :, 0]


class Pcgcv2Synthesis(nn.Module):
    """The synthesis transform g_s, which computes occupancy from y_hat, scale by scale."""

    def __init__(self, shape: Pcgcv2Shape) -> None:
        super().__init__()
        channels = (shape.latent_channels, *shape.channels[2::-1])
        self.scales = nn.ModuleList(
            SynthesisScale(*sizes, shape.blocks) for sizes in pairwise(channels)
        )

    def scale(self, scale: int) -> SynthesisScale:
        """Return the layers of a scale, of which 0 is the coarsest."""
        return cast(SynthesisScale, self.scales[scale])


class PCGCv2(MultiRateNetwork):
    """The network PCGCv2, a PyTorch module with the parameters of one or several rates.

    The analysis transform g_a computes the latent y from voxels, and the synthesis transform g_s
    computes voxels from y. Each rate has gains of y and an entropy bottleneck.
    """

    Shape = Pcgcv2Shape
    shape: Pcgcv2Shape

    def __init__(self, shape: Pcgcv2Shape) -> None:
        super().__init__(shape)
        self.g_a = Pcgcv2Analysis(shape)
        self.g_s = Pcgcv2Synthesis(shape)
        self.add_rates(shape.latent_channels)
