"""Inference of PCGCv2 without gradients; on a CPU, with fused layers.

Pointwise convolutions are computed within an adjacent 3x3x3 convolution. Biases and ReLUs are
applied while a chunk of rows is in the cache. Layers reuse memory. Training and GPUs use the layers
in `model` instead, which round sums in another order. With these layers, existing streams would
decode to points with other last digits, and voxels of nearly equal probability would be exchanged.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pcc_networks.pcgcv2.model import SCALES, InceptionResNet, PCGCv2
from pcc_networks.point_reconstruction import SiblingBlocks, sibling_blocks
from pcc_networks.sparse.convolution import (
    GenerativeTransposedConvolution,
    Neighbourhood,
    SparseConvolution,
    StridedConvolution,
    matrices_of,
    neighbourhood_of,
)
from pcc_networks.sparse.gather_scatter import (
    KernelMap,
    Matrices,
    block_kernel_map,
    voxel_kernel_map,
)
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pcc_networks.sparse.voxels import (
    CENTRE,
    CHILDREN,
    ChildMap,
    Keys,
    VoxelSet,
    kept_children,
    morton_voxels,
    pyramid,
    selected_children,
)
from pcc_networks.weights_file import device_of

_CHUNK_ROWS = 4096
"""Rows of a chunk in layers without neighbours."""


@dataclass(frozen=True)
class FusedConvolution:
    """The matrices and the bias of a convolution, arranged for rows of one or eight children."""

    matrices: Matrices
    centre: Tensor  # of the row itself (children * c, children * d)
    bias: Tensor  # (children * d,)


def fused(layer: SparseConvolution, kernel_map: KernelMap) -> FusedConvolution:
    """Arrange the parameters of a convolution for rows of one or eight children."""
    matrices = matrices_of(layer.kernel.detach(), kernel_map)
    return FusedConvolution(
        matrices, matrices[CENTRE], layer.bias.detach().repeat(kernel_map.children)
    )


def fused_branches(block: InceptionResNet, kernel_map: KernelMap) -> FusedConvolution:
    """Fuse the first layers of both branches of a block into one convolution.

    The central matrix of conv0_0 also computes conv1_0.
    """
    neighbour_matrices = matrices_of(block.conv0_0.kernel.detach(), kernel_map)
    channels, quarter = block.conv0_0.kernel.shape[1:]
    pointwise = torch.kron(torch.eye(kernel_map.children), block.conv1_0.kernel.detach()[0])
    parts = [matrix.view(kernel_map.children * channels, kernel_map.children, quarter)
             for matrix in (neighbour_matrices[CENTRE], pointwise)]  # fmt: skip
    bias = torch.cat([block.conv0_0.bias.detach(), block.conv1_0.bias.detach()])
    centre = torch.cat(parts, dim=2).flatten(1).contiguous()
    return FusedConvolution(neighbour_matrices, centre, bias.repeat(kernel_map.children))


def convolved(
    features: Tensor,
    layer: FusedConvolution,
    neighbourhood: Neighbourhood,
    out: Tensor,
    relu: bool,
) -> Tensor:
    """Convolve features, and return `out`.

    Parameters
    ----------
    features
        Input features (n, children, c).
    layer
        The convolution.
    neighbourhood
        Neighbours of the rows.
    out
        Memory (n, children, d) for the result.
    relu
        Whether to apply a ReLU to the result.
    """

    def work(rows: slice, scratch: Scratch) -> None:
        sums = out[rows]
        _sum_products(features, layer, neighbourhood, rows, scratch, sums)
        if relu:
            sums.relu_()

    neighbourhood.pool.map_chunks(len(features), neighbourhood.chunk_rows(features.shape[2]), work)
    return out


def _sum_products(
    features: Tensor,
    layer: FusedConvolution,
    neighbourhood: Neighbourhood,
    rows: slice,
    scratch: Scratch,
    sums: Tensor,
) -> None:
    row_features = features[rows].reshape(rows.stop - rows.start, -1)
    torch.addmm(layer.bias, row_features, layer.centre, out=sums.view(len(row_features), -1))
    channels = layer.matrices[CENTRE].shape[1] // neighbourhood.kernel_map.children
    onto = sums[:, :, :channels]
    neighbourhood.gather_scatter.add_products(features, layer.matrices, rows, scratch, onto)


def residual_block(
    features: Tensor,
    block: InceptionResNet,
    neighbourhood: Neighbourhood,
    hidden: Tensor,
    out: Tensor,
) -> Tensor:
    """Apply an Inception-ResNet block, and return `out`.

    Parameters
    ----------
    features
        Input features (n, children, c).
    block
        The block.
    neighbourhood
        Neighbours of the rows.
    hidden
        Working memory (n, children, c / 2).
    out
        Memory (n, children, c) for the result.
    """
    convolved(
        features, fused_branches(block, neighbourhood.kernel_map), neighbourhood, hidden, relu=True
    )
    quarter, children = hidden.shape[2] // 2, neighbourhood.kernel_map.children
    conv0_1, conv1_1 = (
        fused(layer, neighbourhood.kernel_map) for layer in (block.conv0_1, block.conv1_1)
    )
    weight, bias = block.conv1_2.kernel.detach()[0], block.conv1_2.bias.detach()

    def work(rows: slice, scratch: Scratch) -> None:
        size = (rows.stop - rows.start) * children
        out0 = scratch.take("out0", size * 2 * quarter).view(-1, children, 2 * quarter)
        _sum_products(hidden[:, :, :quarter], conv0_1, neighbourhood, rows, scratch, out0)
        middle = scratch.take("middle", size * quarter).view(-1, children, quarter)
        _sum_products(hidden[:, :, quarter:], conv1_1, neighbourhood, rows, scratch, middle)
        inputs, outputs = features[rows].view(size, -1), out[rows].view(size, -1)
        torch.add(inputs[:, : 2 * quarter], out0.view(size, -1), out=outputs[:, : 2 * quarter])
        out1 = outputs[:, 2 * quarter :]
        torch.addmm(inputs[:, 2 * quarter :], middle.relu_().view(size, -1), weight, out=out1)
        out1.add_(bias)

    neighbourhood.pool.map_chunks(len(features), neighbourhood.chunk_rows(quarter), work)
    return out


class FeatureBuffers(NamedTuple):
    """Working memory of the layers of a scale."""

    first: Tensor
    second: Tensor
    hidden: Tensor


def _buffers(pool: ThreadPool, rows: int, children: int, channels: int) -> FeatureBuffers:
    sizes = zip(FeatureBuffers._fields, (channels, channels, channels // 2), strict=True)
    flat = (pool.shared.take(name, rows * children * size) for name, size in sizes)
    return FeatureBuffers(*(buffer.view(rows, children, -1) for buffer in flat))


def _residual_blocks(
    features: Tensor,
    blocks: Iterable[InceptionResNet],
    neighbourhood: Neighbourhood,
    buffers: FeatureBuffers,
) -> Tensor:
    for block in blocks:
        other = buffers.second if features is buffers.first else buffers.first
        features = residual_block(features, block, neighbourhood, buffers.hidden, other)
    return features


@dataclass(frozen=True)
class AnalysisResult:
    """The latent of a cloud, and the voxels to which it belongs."""

    y: NDArray[np.float32]  # (m, latent_channels), the latent
    coarse: VoxelSet  # voxels at stride 8
    counts: tuple[int, int, int]  # voxels at strides 1, 2 and 4


def is_fused(model: PCGCv2) -> bool:
    """Return whether a model runs on the CPU, where layers are fused."""
    return device_of(model).type == "cpu"


def analyse(model: PCGCv2, keys: Keys, pool: ThreadPool) -> AnalysisResult:
    """Compute the latent of the voxels with sorted Morton keys (n,), before gains and rounding."""
    sets, child_maps = pyramid(keys, SCALES, pool)
    if is_fused(model):
        features = _conv0(model, sets[0], pool)
        for scale, child_map in enumerate(child_maps):
            neighbours = sets[scale + 1].neighbours
            neighbourhood = neighbourhood_of(neighbours, voxel_kernel_map(), pool)
            features = _analysis_scale(model, scale, features, child_map, neighbourhood)
        y = features[:, 0]
    else:
        y = model.g_a(sets, child_maps, pool)
    counts = (len(sets[0]), len(sets[1]), len(sets[2]))
    return AnalysisResult(y.cpu().numpy().copy(), sets[SCALES], counts)


def _conv0(model: PCGCv2, voxels: VoxelSet, pool: ThreadPool) -> Tensor:
    kernel, bias = model.g_a.conv0.kernel.detach()[:, 0], model.g_a.conv0.bias.detach()
    out = _buffers(pool, len(voxels), 1, len(bias)).first

    def work(rows: slice, _: Scratch) -> None:
        present = torch.from_numpy(voxels.neighbours[:, rows] >= 0).float()
        torch.addmm(bias, present.T, kernel, out=out[rows, 0])
        out[rows].relu_()

    pool.map_chunks(len(voxels), _CHUNK_ROWS, work)
    return out


def _analysis_scale(
    model: PCGCv2, scale: int, features: Tensor, child_map: ChildMap, neighbourhood: Neighbourhood
) -> Tensor:
    layers = model.g_a.scale(scale)
    parents, channels = len(child_map.first) - 1, layers.down.kernel.shape[2]
    downsampled = _downsampled(features, layers.down, child_map, neighbourhood.pool)
    buffers = _buffers(neighbourhood.pool, parents, 1, channels)
    features = _residual_blocks(
        buffers.first.copy_(downsampled), layers.blocks, neighbourhood, buffers
    )
    out = torch.empty(parents, 1, layers.conv.kernel.shape[2])
    conv = fused(layers.conv, neighbourhood.kernel_map)
    return convolved(features, conv, neighbourhood, out, relu=scale + 1 < SCALES)


def _downsampled(
    features: Tensor, down: StridedConvolution, child_map: ChildMap, pool: ThreadPool
) -> Tensor:
    matrix, bias = down.kernel.detach().flatten(0, 1), down.bias.detach()
    parents = len(child_map.first) - 1
    out = torch.empty(parents, len(bias))
    slots = torch.from_numpy(child_map.slots)

    def work(rows: slice, scratch: Scratch) -> None:
        first, last = child_map.first[rows.start], child_map.first[rows.stop]
        count = rows.stop - rows.start
        blocks = scratch.take("children", count * len(matrix)).zero_()
        row_features = blocks.view(CHILDREN * count, -1)
        row_features.index_copy_(
            0, slots[first:last] - CHILDREN * rows.start, features[first:last, 0]
        )
        torch.addmm(bias, blocks.view(count, -1), matrix, out=out[rows])
        out[rows].relu_()

    pool.map_chunks(parents, _CHUNK_ROWS, work)
    return out[:, None]


def synthesise(
    model: PCGCv2,
    y_hat: NDArray[np.float32],
    coarse: VoxelSet,
    counts: Sequence[int],
    pool: ThreadPool,
    child_per_parent: bool = True,
) -> SiblingBlocks:
    """Compute occupied voxels from a latent by the transform g_s.

    Parameters
    ----------
    model
        The network.
    y_hat
        Latent (m, latent_channels), already divided by the gains.
    coarse
        Voxels of the latent, at stride 8.
    counts
        Numbers of voxels to keep at strides 1, 2 and 4.
    pool
        Threads of the convolutions.
    child_per_parent
        Whether each voxel keeps at least its most likely child.

    Returns
    -------
    SiblingBlocks
        The voxels at stride 1 that are kept, with their probabilities.
    """
    if is_fused(model):
        # one allocation for the largest scale
        _reserve(model, (len(coarse), *counts[:0:-1]), pool)
    features, parents = torch.from_numpy(y_hat).to(device_of(model)), coarse
    for scale, keep in enumerate(reversed(counts)):
        children, device_logits = _synthesis_scale(model, scale, features, parents, pool)
        logits = device_logits.cpu().numpy()
        kept = kept_children(logits, keep, child_per_parent)
        if scale + 1 < SCALES:
            rows = torch.from_numpy(kept).to(children.device)
            features = children.flatten(0, 1)[rows]
            parents = selected_children(parents, kept, pool)
    is_kept = np.zeros(logits.shape, dtype=bool)
    is_kept.reshape(-1)[kept] = True
    return sibling_blocks(morton_voxels(parents.keys), logits, is_kept)


def _reserve(model: PCGCv2, parents: Sequence[int], pool: ThreadPool) -> None:
    channels = model.shape.channels[2::-1]
    rows = max(count * width for count, width in zip(parents, channels, strict=True))
    _buffers(pool, rows, CHILDREN, 1)
    pool.shared.take("hidden", rows * CHILDREN // 2)


def _synthesis_scale(
    model: PCGCv2, scale: int, features: Tensor, parents: VoxelSet, pool: ThreadPool
) -> tuple[Tensor, Tensor]:
    layers, kernel_map = model.g_s.scale(scale), block_kernel_map()
    if not is_fused(model):
        children, logits = layers(features, parents, pool)
        return children, logits
    neighbourhood = neighbourhood_of(parents.neighbours, kernel_map, pool)
    buffers = _buffers(pool, len(parents), CHILDREN, layers.conv.kernel.shape[2])
    _upsample(features, layers.up, pool, buffers.first)
    convolved(
        buffers.first, fused(layers.conv, kernel_map), neighbourhood, buffers.second, relu=True
    )
    children = _residual_blocks(buffers.second, layers.blocks, neighbourhood, buffers)
    logits = torch.empty(len(parents), CHILDREN, 1)
    convolved(children, fused(layers.conv_cls, kernel_map), neighbourhood, logits, relu=False)
    return children, logits[:, :, 0]


def _upsample(
    features: Tensor, up: GenerativeTransposedConvolution, pool: ThreadPool, out: Tensor
) -> None:
    matrix, bias = up.matrix().detach().contiguous(), up.bias.detach().repeat(CHILDREN)

    def work(rows: slice, _: Scratch) -> None:
        flat = out[rows].view(rows.stop - rows.start, -1)
        torch.addmm(bias, features[rows], matrix, out=flat)
        flat.relu_()

    pool.map_chunks(len(features), _CHUNK_ROWS, work)
