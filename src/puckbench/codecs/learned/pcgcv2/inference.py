"""PCGCv2 without gradients: the same arithmetic, layers joined and memory kept between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.codecs.learned.pcgcv2.model import SCALES, InceptionResidual, PCGCv2
from puckbench.codecs.learned.point_reconstruction import Octets, octets
from puckbench.codecs.learned.sparse.convolution import (
    Products,
    Site,
    accumulate,
    products_of,
    site,
)
from puckbench.codecs.learned.sparse.kernel_map import Layout, blocks_layout, rows_layout
from puckbench.codecs.learned.sparse.layers import Convolution, Down, Up, kept_children
from puckbench.codecs.learned.sparse.thread_pool import Crew, Scratch
from puckbench.codecs.learned.sparse.voxels import (
    CENTRE,
    CHILDREN,
    Families,
    Keys,
    Voxels,
    descended,
    morton_voxels,
    pyramid,
)

_ROWS = 4096
"""Rows of a chunk where no neighbours are gathered."""


@dataclass(frozen=True)
class Ready:
    """A 3x3x3 convolution as matrices: of the neighbours, of the row itself, and the bias."""

    products: Products
    centre: Tensor
    bias: Tensor
    width: int


def ready(layer: Convolution, layout: Layout) -> Ready:
    """The matrices of a convolution for a layout."""
    products = products_of(layer.kernel.detach(), layout)
    bias = layer.bias.detach()
    return Ready(products, products[CENTRE], bias.repeat(layout.children), len(bias))


def ready_inward(block: InceptionResidual, layout: Layout) -> Ready:
    """Both layers of a block that read its input, the pointwise one as part of the centre."""
    near = products_of(block.near_in.kernel.detach(), layout)
    width, quarter = block.near_in.kernel.shape[1:]
    point = torch.kron(torch.eye(layout.children), block.point_in.kernel.detach()[0])
    parts = [matrix.view(layout.children * width, layout.children, quarter)
             for matrix in (near[CENTRE], point)]  # fmt: skip
    bias = torch.cat([block.near_in.bias.detach(), block.point_in.bias.detach()])
    centre = torch.cat(parts, dim=2).flatten(1).contiguous()
    return Ready(near, centre, bias.repeat(layout.children), 2 * quarter)


def convolved(features: Tensor, layer: Ready, where: Site, into: Tensor, relu: bool) -> Tensor:
    """`into` (n, children, d), filled from features (n, children, c)."""

    def work(rows: slice, scratch: Scratch) -> None:
        sums = into[rows]
        _summed(features, layer, where, rows, scratch, sums)
        if relu:
            sums.relu_()

    where.crew.over(len(features), where.chunk(features.shape[2]), work)
    return into


def _summed(
    features: Tensor, layer: Ready, where: Site, rows: slice, scratch: Scratch, sums: Tensor
) -> None:
    own = features[rows].reshape(rows.stop - rows.start, -1)
    torch.addmm(layer.bias, own, layer.centre, out=sums.view(len(own), -1))
    nearby = layer.products[CENTRE].shape[1] // where.layout.children
    accumulate(features, where, layer.products, rows, scratch, sums[:, :, :nearby])


def residual_block(
    features: Tensor, block: InceptionResidual, where: Site, hidden: Tensor, into: Tensor
) -> Tensor:
    """One Inception-ResNet block, (n, children, c) into the same; hidden: (n, children, c / 2)."""
    convolved(features, ready_inward(block, where.layout), where, hidden, relu=True)
    quarter = hidden.shape[2] // 2
    near, middle = (ready(layer, where.layout) for layer in (block.near_out, block.middle))
    weight, bias = block.point_out.kernel.detach()[0], block.point_out.bias.detach()

    def work(rows: slice, scratch: Scratch) -> None:
        size = (rows.stop - rows.start) * where.layout.children
        first = scratch.take("near", size * 2 * quarter).view(
            -1, where.layout.children, 2 * quarter
        )
        _summed(hidden[:, :, :quarter], near, where, rows, scratch, first)
        second = scratch.take("middle", size * quarter).view(-1, where.layout.children, quarter)
        _summed(hidden[:, :, quarter:], middle, where, rows, scratch, second)
        own, out = features[rows].view(size, -1), into[rows].view(size, -1)
        torch.add(own[:, : 2 * quarter], first.view(size, -1), out=out[:, : 2 * quarter])
        tail = out[:, 2 * quarter :]
        torch.addmm(own[:, 2 * quarter :], second.relu_().view(size, -1), weight, out=tail)
        tail.add_(bias)

    where.crew.over(len(features), where.chunk(quarter), work)
    return into


@dataclass(frozen=True)
class Memory:
    """Three arrays that the layers of a scale pass features through."""

    here: Tensor
    there: Tensor
    hidden: Tensor


def _memory(crew: Crew, rows: int, children: int, width: int) -> Memory:
    sizes = {"here": width, "there": width, "hidden": width // 2}
    flat = {name: crew.shared.take(name, rows * children * wide) for name, wide in sizes.items()}
    return Memory(**{name: flat[name].view(rows, children, wide) for name, wide in sizes.items()})


def _blocks(
    features: Tensor, blocks: Iterable[InceptionResidual], where: Site, memory: Memory
) -> Tensor:
    for block in blocks:
        other = memory.there if features is memory.here else memory.here
        features = residual_block(features, block, where, memory.hidden, other)
    return features


@dataclass(frozen=True)
class Analysis:
    """What the encoder makes of a block of voxels.

    latent: (m, channels) float32, at stride 8. coarse: the voxels there. counts: voxels at strides
    1, 2 and 4.
    """

    latent: NDArray[np.float32]
    coarse: Voxels
    counts: tuple[int, int, int]


def analyse(model: PCGCv2, keys: Keys, crew: Crew) -> Analysis:
    """Features of voxels in Morton order."""
    sets, families = pyramid(keys, SCALES, crew)
    features = _first_features(model, sets[0], crew)
    for scale in range(SCALES):
        where = site(sets[scale + 1].neighbours, rows_layout(), crew)
        features = _encoder_scale(model, scale, features, families[scale], where)
    counts = (len(sets[0]), len(sets[1]), len(sets[2]))
    return Analysis(features[:, 0].numpy().copy(), sets[SCALES], counts)


def _first_features(model: PCGCv2, voxels: Voxels, crew: Crew) -> Tensor:
    """The first convolution and its ReLU: (n, 1, c). Its input is one wherever there is a voxel."""
    kernel, bias = model.encoder.first.kernel.detach()[:, 0], model.encoder.first.bias.detach()
    into = _memory(crew, len(voxels), 1, len(bias)).here

    def work(rows: slice, _: Scratch) -> None:
        present = torch.from_numpy(voxels.neighbours[:, rows] >= 0).float()
        torch.addmm(bias, present.T, kernel, out=into[rows, 0])
        into[rows].relu_()

    crew.over(len(voxels), _ROWS, work)
    return into


def _encoder_scale(
    model: PCGCv2, scale: int, features: Tensor, families: Families, where: Site
) -> Tensor:
    layers = model.encoder.scale(scale)
    parents, width = len(families.first) - 1, layers.down.kernel.shape[2]
    lowered = _lowered(features, layers.down, families, where.crew)
    memory = _memory(where.crew, parents, 1, width)
    features = _blocks(memory.here.copy_(lowered), layers.blocks, where, memory)
    into = torch.empty(parents, 1, layers.conv.kernel.shape[2])
    return convolved(features, ready(layers.conv, where.layout), where, into, scale + 1 < SCALES)


def _lowered(features: Tensor, down: Down, families: Families, crew: Crew) -> Tensor:
    """The stride-2 convolution and its ReLU: (n, 1, c) to (m, 1, d)."""
    matrix, bias = down.kernel.detach().flatten(0, 1), down.bias.detach()
    parents = len(families.first) - 1
    into = torch.empty(parents, len(bias))
    slots = torch.from_numpy(families.slots)

    def work(rows: slice, scratch: Scratch) -> None:
        first, last = families.first[rows.start], families.first[rows.stop]
        count = rows.stop - rows.start
        blocks = scratch.take("children", count * len(matrix)).zero_()
        own = blocks.view(CHILDREN * count, -1)
        own.index_copy_(0, slots[first:last] - CHILDREN * rows.start, features[first:last, 0])
        torch.addmm(bias, blocks.view(count, -1), matrix, out=into[rows])
        into[rows].relu_()

    crew.over(parents, _ROWS, work)
    return into[:, None]


def synthesise(
    model: PCGCv2,
    latent: NDArray[np.float32],
    coarse: Voxels,
    counts: Sequence[int],
    crew: Crew,
    families: bool = True,
) -> Octets:
    """The decoded voxels, counts[0] of them, from the latent (m, channels) at stride 8.

    counts: voxels to keep at strides 1, 2 and 4. families: every voxel keeps a child if it can.
    """
    parents, features = coarse, torch.from_numpy(latent)
    _reserve(model, (len(coarse), *counts[:0:-1]), crew)
    for scale, keep in enumerate(reversed(counts)):
        children, logits = _decoder_scale(model, scale, features, parents, crew)
        kept = kept_children(logits.numpy(), keep, families)
        if scale + 1 < SCALES:
            features = children.view(-1, children.shape[2])[torch.from_numpy(kept)]
            parents = descended(parents, kept, crew)
    chosen = np.zeros(logits.shape, dtype=bool)
    chosen.reshape(-1)[kept] = True
    return octets(morton_voxels(parents.keys), logits.numpy(), chosen)


def _reserve(model: PCGCv2, parents: Sequence[int], crew: Crew) -> None:
    """Ask once for the memory of the largest scale."""
    widths = model.shape.widths[2::-1]
    rows = max(count * width for count, width in zip(parents, widths, strict=True))
    _memory(crew, rows, CHILDREN, 1)
    crew.shared.take("hidden", rows * CHILDREN // 2)


def _decoder_scale(
    model: PCGCv2, scale: int, features: Tensor, parents: Voxels, crew: Crew
) -> tuple[Tensor, Tensor]:
    """Features (m, 8, d) of all children and their logits (m, 8)."""
    layers, layout = model.decoder.scale(scale), blocks_layout()
    where = site(parents.neighbours, layout, crew)
    memory = _memory(crew, len(parents), CHILDREN, layers.conv.kernel.shape[2])
    _raised(features, layers.up, crew, memory.here)
    convolved(memory.here, ready(layers.conv, layout), where, memory.there, relu=True)
    children = _blocks(memory.there, layers.blocks, where, memory)
    logits = torch.empty(len(parents), CHILDREN, 1)
    convolved(children, ready(layers.logits, layout), where, logits, relu=False)
    return children, logits[:, :, 0]


def _raised(features: Tensor, up: Up, crew: Crew, into: Tensor) -> None:
    """The generative transposed convolution and its ReLU: (m, c) into (m, 8, d)."""
    matrix, bias = up.matrix().detach().contiguous(), up.bias.detach().repeat(CHILDREN)

    def work(rows: slice, _: Scratch) -> None:
        flat = into[rows].view(rows.stop - rows.start, -1)
        torch.addmm(bias, features[rows], matrix, out=flat)
        flat.relu_()

    crew.over(len(features), _ROWS, work)
