"""Sparse 3x3x3 convolution with gradients, and the layers of which the networks consist."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from pcc_networks.sparse.gather_scatter import (
    CompiledGatherScatter,
    GatherScatter,
    KernelMap,
    Matrices,
    TorchGatherScatter,
)
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pcc_networks.sparse.voxels import CENTRE, CHILDREN, OFFSETS, ChildMap, NeighbourTable

_CHUNK_FLOATS = 2**20
"""Approximate number of gathered features of a chunk. Larger chunks do not fit the caches of small
machines; smaller chunks spend more time in Python, on one thread."""
_MIN_ROWS, _MAX_ROWS = 64, 4096
_DEVICE_CHUNK_FLOATS, _DEVICE_ROWS = 2**26, 2**20
"""Features and rows of a chunk on a GPU, where starting a computation is slow."""


@dataclass(frozen=True)
class Neighbourhood:
    """The neighbours, threads and chunk sizes for convolutions of a set of voxels."""

    gather_scatter: GatherScatter
    pool: ThreadPool
    chunk_floats: int = _CHUNK_FLOATS  # approximate number of features that are gathered at once
    max_rows: int = _MAX_ROWS

    @property
    def kernel_map(self) -> KernelMap:
        """The kernel map, which says whether a row holds one voxel or eight children."""
        return self.gather_scatter.kernel_map

    def chunk_rows(self, channels: int) -> int:
        """Return the number of rows that are computed at once, for this number of channels."""
        rows = self.chunk_floats // (self.kernel_map.typical_read * channels)
        return int(np.clip(rows, _MIN_ROWS, self.max_rows))


def neighbourhood_of(
    table: NeighbourTable,
    kernel_map: KernelMap,
    pool: ThreadPool,
    device: torch.device | None = None,
) -> Neighbourhood:
    """Prepare convolutions of a set of voxels.

    Parameters
    ----------
    table
        Neighbour table (27, n) of the rows.
    kernel_map
        Whether a row holds one voxel or eight children.
    pool
        Threads of the convolutions.
    device
        Device on which the convolutions run, by default the CPU.
    """
    if device is None or device.type == "cpu":
        return Neighbourhood(CompiledGatherScatter(table, kernel_map), pool)
    gather_scatter = TorchGatherScatter(torch.from_numpy(table).long().to(device), kernel_map)
    return Neighbourhood(gather_scatter, pool, _DEVICE_CHUNK_FLOATS, _DEVICE_ROWS)


def convolve(
    features: Tensor, kernel: Tensor, bias: Tensor, neighbourhood: Neighbourhood
) -> Tensor:
    """Apply a sparse 3x3x3 convolution, with gradients.

    Voxels outside the set count as zero and get no result.

    Parameters
    ----------
    features
        Features (n, children, c).
    kernel
        Kernel (27, c, d).
    bias
        Bias (d,).
    neighbourhood
        Neighbours of the rows.

    Returns
    -------
    Tensor
        Features (n, children, d).
    """
    pairs = torch.from_numpy(neighbourhood.kernel_map.kernel_of_pair).to(kernel.device)
    result: Tensor = _Convolution.apply(features, kernel[pairs], bias, neighbourhood)  # type: ignore[no-untyped-call]
    return result


def matrices_of(kernel: Tensor, kernel_map: KernelMap) -> Matrices:
    """Return the matrix of each offset between rows, from a kernel (27, c, d)."""
    return _matrices(kernel[torch.from_numpy(kernel_map.kernel_of_pair)], kernel_map)


class _Convolution(torch.autograd.Function):
    """Differentiable `convolve`, with a kernel matrix (c, d) for each pair of children."""

    @staticmethod
    def forward(
        ctx: Any, features: Tensor, kernels: Tensor, bias: Tensor, neighbourhood: Neighbourhood
    ) -> Tensor:
        ctx.save_for_backward(features, kernels)
        ctx.neighbourhood = neighbourhood
        return _apply(
            features.detach(),
            _matrices(kernels.detach(), neighbourhood.kernel_map),
            bias,
            neighbourhood,
        )

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, Tensor, None]:
        features, kernels = ctx.saved_tensors
        gradient = gradient.contiguous()
        input_gradient = None
        if ctx.needs_input_grad[0]:
            # the set's neighbourhood is symmetric: backwards, offset and children swap sides
            matrices = _matrices(kernels.detach(), ctx.neighbourhood.kernel_map)[::-1]
            zero_bias = gradient.new_zeros(kernels.shape[1])
            input_gradient = _apply(
                gradient, tuple(matrix.T for matrix in matrices), zero_bias, ctx.neighbourhood
            )
        kernel_gradient = _kernel_gradient(features.detach(), gradient, ctx.neighbourhood)
        return input_gradient, kernel_gradient, gradient.sum(dim=(0, 1)), None


def _matrices(kernels: Tensor, kernel_map: KernelMap) -> Matrices:
    parts = torch.split(kernels, [count * count for count in kernel_map.sizes])
    return tuple(
        part.view(count, count, *part.shape[1:])
        .transpose(1, 2)
        .flatten(2)
        .flatten(0, 1)
        .contiguous()
        for part, count in zip(parts, kernel_map.sizes, strict=True)
    )


def _apply(
    features: Tensor, matrices: Matrices, bias: Tensor, neighbourhood: Neighbourhood
) -> Tensor:
    rows, children, width = features.shape
    result = features.new_empty(rows, children, len(bias))
    biases = bias.detach().repeat(children)

    def work(chunk: slice, scratch: Scratch) -> None:
        sums = result[chunk]
        row_features = features[chunk].reshape(len(sums), -1)
        torch.addmm(biases, row_features, matrices[CENTRE], out=sums.view(len(sums), -1))
        neighbourhood.gather_scatter.add_products(features, matrices, chunk, scratch, sums)

    neighbourhood.pool.map_chunks(rows, neighbourhood.chunk_rows(width), work)
    return result


def _kernel_gradient(features: Tensor, gradient: Tensor, neighbourhood: Neighbourhood) -> Tensor:
    kernel_map, gather = neighbourhood.kernel_map, neighbourhood.gather_scatter.gather
    widths = features.shape[2], gradient.shape[2]

    def work(chunk: slice, scratch: Scratch) -> Tensor:
        inputs = gather(features, chunk, scratch)
        outputs = gather(gradient, chunk, scratch, at_output=True)
        inputs[CENTRE], outputs[CENTRE] = features[chunk].flatten(1), gradient[chunk].flatten(1)
        return torch.cat(
            [
                torch.mm(read.T, written)
                .view(count, widths[0], count, widths[1])
                .transpose(1, 2)
                .flatten(0, 1)
                for read, written, count in zip(inputs, outputs, kernel_map.sizes, strict=True)
            ]
        )

    chunk_rows = 4 * neighbourhood.chunk_rows(widths[0])
    chunks = neighbourhood.pool.map_chunks(len(features), chunk_rows, work)
    return torch.stack(chunks).sum(dim=0) if len(chunks) > 1 else chunks[0]


class SparseLayer(nn.Module):
    """Base class of layers with a kernel (offsets, c, d) and a bias (d,).

    The offsets of the kernel are ordered with x fastest.
    """

    offsets = OFFSETS

    def __init__(self, in_channels: int, out_channels: int, offsets: int | None = None) -> None:
        super().__init__()
        offsets = offsets or self.offsets
        spread = 1 / math.sqrt(offsets * in_channels)
        self.kernel = nn.Parameter(
            torch.empty(offsets, in_channels, out_channels).uniform_(-spread, spread)
        )
        self.bias = nn.Parameter(torch.zeros(out_channels))


class SparseConvolution(SparseLayer):
    """A 3x3x3 convolution of features (n, children, c) to (n, children, d) at the same voxels."""

    def forward(self, features: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        return convolve(features, self.kernel, self.bias, neighbourhood)


class PointwiseConvolution(SparseLayer):
    """A 1x1x1 convolution of features (n, children, c) to (n, children, d)."""

    offsets = 1

    def forward(self, features: Tensor) -> Tensor:
        return features @ self.kernel[0] + self.bias


class StridedConvolution(SparseLayer):
    """A 2x2x2 convolution with stride 2, from a set of voxels to the next coarser set."""

    offsets = CHILDREN

    def forward(self, features: Tensor, child_map: ChildMap) -> Tensor:
        blocks = features.new_zeros(CHILDREN * (len(child_map.first) - 1), features.shape[2])
        slots = torch.from_numpy(child_map.slots).to(features.device)
        blocks = blocks.index_copy(0, slots, features[:, 0])
        sums = blocks.view(len(child_map.first) - 1, -1) @ self.kernel.flatten(0, 1) + self.bias
        return sums[:, None]


class GenerativeTransposedConvolution(SparseLayer):
    """A transposed 2x2x2 convolution with stride 2, from voxels to all their children."""

    offsets = CHILDREN

    def matrix(self) -> Tensor:
        """Return the kernel as a matrix (c, 8 * d)."""
        return self.kernel.transpose(0, 1).flatten(1)

    def forward(self, features: Tensor) -> Tensor:
        return (features @ self.matrix()).view(len(features), CHILDREN, -1) + self.bias
