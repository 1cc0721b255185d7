"""Sparse 3x3x3 convolution: gather, multiply, scatter, for one chunk of rows after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from puckbench.learned.sparse.gather_scatter import (
    CompiledGatherScatter,
    GatherScatter,
    TorchGatherScatter,
    segments,
)
from puckbench.learned.sparse.kernel_map import KernelMap
from puckbench.learned.sparse.thread_pool import Scratch, ThreadPool
from puckbench.learned.sparse.voxels import CENTRE, OFFSETS, NeighbourTable

_CHUNK_FLOATS = 2**20
"""Gathered features of a chunk, about: larger chunks leave the caches of small machines, smaller
ones spend more time in Python, which two threads cannot share."""
_MIN_ROWS, _MAX_ROWS = 64, 4096
_DEVICE_CHUNK_FLOATS, _DEVICE_ROWS = 2**26, 2**20
"""Of another device, where starting a computation takes longer than computing a small chunk."""

Matrices = tuple[Tensor, ...]
"""For each offset between rows the matrix (count * channels read, count * channels written)."""


@dataclass(frozen=True)
class Neighbourhood:
    """The set of voxels that a layer works on.

    Parameters
    ----------
    gather_scatter
        Moves features (n, children, channels) between neighbouring rows.
    kernel_map
        What rows are: voxels, with one child, or parents with eight.
    pool
        The threads that compute.
    chunk_floats
        Features gathered at once, about.
    max_rows
        Rows of a chunk, at most.
    """

    gather_scatter: GatherScatter
    kernel_map: KernelMap
    pool: ThreadPool
    chunk_floats: int = _CHUNK_FLOATS
    max_rows: int = _MAX_ROWS

    def chunk_rows(self, channels: int) -> int:
        """Rows of a chunk for features of a number of channels."""
        rows = self.chunk_floats // (self.kernel_map.typical_read * channels)
        return int(np.clip(rows, _MIN_ROWS, self.max_rows))


def neighbourhood(
    table: NeighbourTable,
    kernel_map: KernelMap,
    pool: ThreadPool,
    device: torch.device | None = None,
) -> Neighbourhood:
    """The neighbourhood of a table (27, n), for tensors of a device (default: the CPU)."""
    if device is None or device.type == "cpu":
        return Neighbourhood(CompiledGatherScatter(table), kernel_map, pool)
    return device_neighbourhood(table, kernel_map, pool, device)


def device_neighbourhood(
    table: NeighbourTable, kernel_map: KernelMap, pool: ThreadPool, device: torch.device
) -> Neighbourhood:
    """The neighbourhood of a table (27, n), by PyTorch's own functions whatever the device."""
    moved = TorchGatherScatter(torch.from_numpy(table).long().to(device))
    return Neighbourhood(moved, kernel_map, pool, _DEVICE_CHUNK_FLOATS, _DEVICE_ROWS)


def convolve(features: Tensor, kernel: Tensor, bias: Tensor, where: Neighbourhood) -> Tensor:
    """Convolve features; voxels outside the set count as zero and get no value. Differentiable.

    Parameters
    ----------
    features
        (n, children, c).
    kernel
        (27, c, d).
    bias
        (d,).
    where
        The set of voxels.

    Returns
    -------
    Tensor
        (n, children, d).
    """
    pairs = torch.from_numpy(where.kernel_map.kernel_of_pair).to(kernel.device)
    result: Tensor = _Convolution.apply(features, kernel[pairs], bias, where)  # type: ignore[no-untyped-call]
    return result


def matrices_of(kernel: Tensor, kernel_map: KernelMap) -> Matrices:
    """The matrices of a kernel (27, c, d) for `accumulate`."""
    return _matrices(kernel[torch.from_numpy(kernel_map.kernel_of_pair)], kernel_map)


def accumulate(
    features: Tensor,
    where: Neighbourhood,
    matrices: Matrices,
    rows: slice,
    scratch: Scratch,
    sums: Tensor,
) -> None:
    """Add to sums (rows, children, d) the products of a chunk's neighbours, not of the rows.

    The features are (n, children, c).
    """
    width = sums.shape[2]
    layout = where.gather_scatter.layout(where.kernel_map, rows)
    gathered = where.gather_scatter.gather(features, where.kernel_map, rows, scratch)
    room = _like(features, scratch, layout.size * width)
    made = segments(room, layout, width)
    for part, matrix, product in zip(gathered, matrices, made, strict=True):
        if part is not None and product is not None:
            torch.mm(part, matrix, out=product)
    where.gather_scatter.scatter_add(made, sums, where.kernel_map, rows)


def _like(features: Tensor, scratch: Scratch, size: int) -> Tensor:
    if features.device.type == "cpu":
        return scratch.take("products", size)
    return features.new_empty(size)


class _Convolution(torch.autograd.Function):
    """`convolve` with one kernel for each pair of children: (pairs, c, d)."""

    @staticmethod
    def forward(
        ctx: Any, features: Tensor, kernels: Tensor, bias: Tensor, where: Neighbourhood
    ) -> Tensor:
        ctx.save_for_backward(features, kernels)
        ctx.where = where
        return _apply(features.detach(), _matrices(kernels.detach(), where.kernel_map), bias, where)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, Tensor, None]:
        features, kernels = ctx.saved_tensors
        gradient = gradient.contiguous()
        back = None
        if ctx.needs_input_grad[0]:
            # the set's neighbourhood is symmetric: backwards, offset and children swap sides
            matrices = _matrices(kernels.detach(), ctx.where.kernel_map)[::-1]
            none = gradient.new_zeros(kernels.shape[1])
            back = _apply(gradient, tuple(matrix.T for matrix in matrices), none, ctx.where)
        of_kernels = _kernel_gradient(features.detach(), gradient, ctx.where)
        return back, of_kernels, gradient.sum(dim=(0, 1)), None


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


def _apply(features: Tensor, matrices: Matrices, bias: Tensor, where: Neighbourhood) -> Tensor:
    rows, children, width = features.shape
    result = features.new_empty(rows, children, len(bias))
    biases = bias.detach().repeat(children)

    def work(chunk: slice, scratch: Scratch) -> None:
        sums = result[chunk]
        own = features[chunk].reshape(len(sums), -1)
        torch.addmm(biases, own, matrices[CENTRE], out=sums.view(len(sums), -1))
        accumulate(features, where, matrices, chunk, scratch, sums)

    where.pool.map_chunks(rows, where.chunk_rows(width), work)
    return result


def _kernel_gradient(features: Tensor, gradient: Tensor, where: Neighbourhood) -> Tensor:
    kernel_map, widths = where.kernel_map, (features.shape[2], gradient.shape[2])

    def work(chunk: slice, scratch: Scratch) -> Tensor:
        inputs = where.gather_scatter.gather(features, kernel_map, chunk, scratch)
        outputs = where.gather_scatter.gather(gradient, kernel_map, chunk, scratch, own=True)
        inputs[CENTRE] = features[chunk].reshape(chunk.stop - chunk.start, -1)
        outputs[CENTRE] = gradient[chunk].reshape(chunk.stop - chunk.start, -1)
        parts = [
            _pair_gradient(inputs[offset], outputs[offset], kernel_map.sizes[offset], widths)
            for offset in range(OFFSETS)
        ]
        return torch.cat([part.to(features.device) for part in parts])

    chunks = where.pool.map_chunks(len(features), 4 * where.chunk_rows(widths[0]), work)
    return torch.stack(chunks).sum(dim=0) if len(chunks) > 1 else chunks[0]


def _pair_gradient(
    inputs: Tensor | None, outputs: Tensor | None, count: int, widths: tuple[int, int]
) -> Tensor:
    if inputs is None or outputs is None:
        return torch.zeros(count * count, *widths)
    both = torch.mm(inputs.T, outputs).view(count, widths[0], count, widths[1])
    return both.transpose(1, 2).flatten(0, 1)
