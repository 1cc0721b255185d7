"""3x3x3 convolution on a set of voxels: gather, multiply, add, a chunk of rows at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from puckbench.codecs.learned.sparse.gather_scatter import (
    CompiledMover,
    Mover,
    TorchMover,
    segments,
)
from puckbench.codecs.learned.sparse.kernel_map import Layout
from puckbench.codecs.learned.sparse.thread_pool import Crew, Scratch
from puckbench.codecs.learned.sparse.voxels import CENTRE, OFFSETS, Table

_CHUNK_FLOATS = 2**20
"""Gathered features of one chunk, about: larger ones leave the caches of small machines,
smaller ones spend more of their time in Python, which two threads cannot share."""
_FEWEST_ROWS, _MOST_ROWS = 64, 4096

Products = tuple[Tensor, ...]
"""For each offset between rows the matrix (many * width read, many * width written)."""


@dataclass(frozen=True)
class Site:
    """Where a layer works: who neighbours whom, how features are laid out, and who computes.

    Features are (n, children, width): one child for rows, eight for blocks.
    """

    mover: Mover
    layout: Layout
    crew: Crew
    chunk_floats: int = _CHUNK_FLOATS

    def chunk(self, width: int) -> int:
        """Rows of a chunk for features of this width."""
        rows = self.chunk_floats // (self.layout.usually_read * width)
        return int(np.clip(rows, _FEWEST_ROWS, _MOST_ROWS))


def site(table: Table, layout: Layout, crew: Crew, device: torch.device | None = None) -> Site:
    """The site of a neighbour table (27, n), for tensors of a device (default: the CPU)."""
    if device is None or device.type == "cpu":
        return Site(CompiledMover(table), layout, crew)
    return Site(TorchMover(torch.from_numpy(table).long().to(device)), layout, crew)


def convolve(features: Tensor, kernel: Tensor, bias: Tensor, where: Site) -> Tensor:
    """Features (n, children, d) from (n, children, c), a kernel (27, c, d) and a bias (d).

    Differentiable. Voxels that are not in the set count as zero, and get no value.
    """
    pairs = torch.from_numpy(where.layout.kernel_of_pair).to(kernel.device)
    result: Tensor = _Convolution.apply(features, kernel[pairs], bias, where)  # type: ignore[no-untyped-call]
    return result


def products_of(kernel: Tensor, layout: Layout) -> Products:
    """The matrices of a kernel (27, c, d), for `accumulate`."""
    return _products(kernel[torch.from_numpy(layout.kernel_of_pair)], layout)


def accumulate(
    features: Tensor, where: Site, products: Products, rows: slice, scratch: Scratch, sums: Tensor
) -> None:
    """Add the products of a chunk's neighbours, the rows themselves left out, to `sums`.

    features: (n, children, c). sums: (rows, children, d).
    """
    width = sums.shape[2]
    gathered = where.mover.gather(features, where.layout, rows, scratch)
    counts = np.array([0 if part is None else len(part) for part in gathered])
    size = int(counts @ where.layout.many) * width
    made = segments(_like(features, scratch, size), counts, where.layout, width)
    for part, matrix, product in zip(gathered, products, made, strict=True):
        if part is not None and product is not None:
            torch.mm(part, matrix, out=product)
    where.mover.add(made, sums, where.layout, rows)


def _like(features: Tensor, scratch: Scratch, size: int) -> Tensor:
    if features.device.type == "cpu":
        return scratch.take("products", size)
    return features.new_empty(size)


class _Convolution(torch.autograd.Function):
    """`convolve` with one kernel for each pair of children: (pairs, c, d)."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, kernels: Tensor, bias: Tensor, where: Site) -> Tensor:
        ctx.save_for_backward(features, kernels)
        ctx.where = where
        return _apply(features.detach(), _products(kernels.detach(), where.layout), bias, where)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, Tensor, None]:
        features, kernels = ctx.saved_tensors
        gradient = gradient.contiguous()
        back = None
        if ctx.needs_input_grad[0]:
            # the set's neighbourhood is symmetric: backwards, offset and children swap sides
            products = _products(kernels.detach(), ctx.where.layout)[::-1]
            none = gradient.new_zeros(kernels.shape[1])
            back = _apply(gradient, tuple(product.T for product in products), none, ctx.where)
        of_kernels = _kernel_gradient(features.detach(), gradient, ctx.where)
        return back, of_kernels, gradient.sum(dim=(0, 1)), None


def _products(kernels: Tensor, layout: Layout) -> Products:
    parts = torch.split(kernels, [many * many for many in layout.sizes])
    return tuple(
        part.view(many, many, *part.shape[1:]).transpose(1, 2).flatten(2).flatten(0, 1).contiguous()
        for part, many in zip(parts, layout.sizes, strict=True)
    )


def _apply(features: Tensor, products: Products, bias: Tensor, where: Site) -> Tensor:
    rows, children, width = features.shape
    result = features.new_empty(rows, children, len(bias))
    biases = bias.detach().repeat(children)

    def work(chunk: slice, scratch: Scratch) -> None:
        sums = result[chunk]
        own = features[chunk].reshape(len(sums), -1)
        torch.addmm(biases, own, products[CENTRE], out=sums.view(len(sums), -1))
        accumulate(features, where, products, chunk, scratch, sums)

    where.crew.over(rows, where.chunk(width), work)
    return result


def _kernel_gradient(features: Tensor, gradient: Tensor, where: Site) -> Tensor:
    layout, widths = where.layout, (features.shape[2], gradient.shape[2])

    def work(chunk: slice, scratch: Scratch) -> Tensor:
        inputs = where.mover.gather(features, layout, chunk, scratch)
        outputs = where.mover.gather(gradient, layout, chunk, scratch, own=True)
        inputs[CENTRE] = features[chunk].reshape(chunk.stop - chunk.start, -1)
        outputs[CENTRE] = gradient[chunk].reshape(chunk.stop - chunk.start, -1)
        parts = [
            _pair_gradient(inputs[offset], outputs[offset], layout.sizes[offset], widths)
            for offset in range(OFFSETS)
        ]
        return torch.cat([part.to(features.device) for part in parts])

    chunks = where.crew.over(len(features), 4 * where.chunk(widths[0]), work)
    return torch.stack(chunks).sum(dim=0) if len(chunks) > 1 else chunks[0]


def _pair_gradient(
    inputs: Tensor | None, outputs: Tensor | None, many: int, widths: tuple[int, int]
) -> Tensor:
    if inputs is None or outputs is None:
        return torch.zeros(many * many, *widths)
    both = torch.mm(inputs.T, outputs).view(many, widths[0], many, widths[1])
    return both.transpose(1, 2).flatten(0, 1)
