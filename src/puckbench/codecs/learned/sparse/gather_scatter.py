"""Bringing neighbours' features together, and handing products back: compiled, or in PyTorch.

Both do the same to the same numbers. The compiled one serves the CPU; the other one any device.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.codecs.learned.sparse.kernel_map import Layout
from puckbench.codecs.learned.sparse.thread_pool import Scratch
from puckbench.codecs.learned.sparse.vector_copies import add_run, copy_run
from puckbench.codecs.learned.sparse.voxels import CENTRE, OFFSETS
from puckbench.core.compiling import compiled

Flat = NDArray[np.float32]
Segments = list[Tensor | None]
"""For each offset the features (m, many * width) of its m pairs of rows; None without any."""


class Mover(Protocol):
    """Moves features between rows that are neighbours, for the rows of one chunk."""

    def gather(
        self, features: Tensor, layout: Layout, rows: slice, scratch: Scratch, own: bool = False
    ) -> Segments:
        """For each offset but the centre, what rows that have a neighbour there read from it.

        features: (n, children, width). own: the row's own written children instead.
        """

    def add(self, products: Segments, onto: Tensor, layout: Layout, rows: slice) -> None:
        """Add products to the children they go to; onto: (rows, children, width)."""


class CompiledMover:
    """For tensors of the CPU; table: (27, n) int32."""

    def __init__(self, table: NDArray[np.int32]) -> None:
        self.table = table

    def gather(
        self, features: Tensor, layout: Layout, rows: slice, scratch: Scratch, own: bool = False
    ) -> Segments:
        """See `Mover`."""
        width, name = features.shape[2], "own" if own else "read"
        room = scratch.take(name, (rows.stop - rows.start) * layout.most_read * width)
        counts = np.zeros(OFFSETS, dtype=np.int64)
        _gatherer(width)(
            *_flat(features), self.table, rows.start, rows.stop, layout.many,
            layout.written if own else layout.read, own, room.numpy(), counts,
        )  # fmt: skip
        return segments(room, counts, layout, width)

    def add(self, products: Segments, onto: Tensor, layout: Layout, rows: slice) -> None:
        """See `Mover`; the products are one after the other in memory, as `segments` lays them."""
        found = next((part for part in products if part is not None), None)
        if found is not None:
            whole = found.as_strided((_after(found),), (1,), found.storage_offset())
            _adder(onto.shape[2])(
                whole.numpy(), self.table, rows.start, rows.stop, layout.many, layout.written,
                *_flat(onto),
            )  # fmt: skip


class TorchMover:
    """For tensors of any device; table: (27, n) int64 there."""

    def __init__(self, table: Tensor) -> None:
        self.table = table

    def _pairs(self, offset: int, rows: slice) -> tuple[Tensor, Tensor]:
        others = self.table[offset, rows]
        inside = torch.nonzero(others >= 0)[:, 0]
        return inside, others[inside]

    def gather(
        self, features: Tensor, layout: Layout, rows: slice, scratch: Scratch, own: bool = False
    ) -> Segments:
        """See `Mover`."""
        found: Segments = []
        for offset in range(OFFSETS):
            inside, others = self._pairs(offset, rows)
            if offset == CENTRE or len(inside) == 0:
                found.append(None)
                continue
            children = (layout.written if own else layout.read)[offset, : layout.sizes[offset]]
            chosen = features[rows.start + inside if own else others]
            found.append(chosen[:, children.tolist()].flatten(1))
        return found

    def add(self, products: Segments, onto: Tensor, layout: Layout, rows: slice) -> None:
        """See `Mover`."""
        for offset, product in enumerate(products):
            if product is not None:
                inside, _ = self._pairs(offset, rows)
                children = torch.from_numpy(layout.written[offset, : layout.sizes[offset]])
                target = (inside[:, None], children.to(inside.device)[None, :])
                onto[target] = onto[target] + product.view(len(inside), len(children), -1)


def segments(room: Tensor, counts: NDArray[np.int64], layout: Layout, width: int) -> Segments:
    """Cut flat memory into the pairs of each offset, one after the other."""
    found: Segments = []
    at = 0
    for pairs, many in zip(counts.tolist(), layout.sizes, strict=True):
        size = pairs * many * width
        found.append(room[at : at + size].view(pairs, many * width) if pairs else None)
        at += size
    return found


def _flat(features: Tensor) -> tuple[Any, int, int]:
    """Memory from the first feature on, and the strides of rows and children in it."""
    flat = features.as_strided((_after(features),), (1,), features.storage_offset())
    return flat.numpy(), features.stride(0), features.stride(1)


def _after(features: Tensor) -> int:
    """Elements of the memory from the tensor's first one on."""
    return int(features.untyped_storage().nbytes() // 4 - features.storage_offset())


@cache
def _gatherer(width: int) -> Callable[..., None]:
    @compiled
    def gather(
        features: Flat,
        row_stride: int,
        child_stride: int,
        table: NDArray[np.int32],
        first: int,
        last: int,
        many: NDArray[np.int64],
        children: NDArray[np.int64],
        own: bool,
        into: Flat,
        counts: NDArray[np.int64],
    ) -> None:
        at = 0
        for offset in range(OFFSETS):
            if offset == CENTRE:
                continue
            pairs = 0
            for row in range(first, last):
                other = table[offset, row]
                if other >= 0:
                    pairs += 1
                    start = row_stride * (row if own else other)
                    for j in range(many[offset]):
                        child = children[offset, j]
                        copy_run(into, at, features, start + child * child_stride, width)
                        at += width
            counts[offset] = pairs

    return gather


@cache
def _adder(width: int) -> Callable[..., None]:
    @compiled
    def add(
        products: Flat,
        table: NDArray[np.int32],
        first: int,
        last: int,
        many: NDArray[np.int64],
        children: NDArray[np.int64],
        onto: Flat,
        row_stride: int,
        child_stride: int,
    ) -> None:
        at = 0
        for offset in range(OFFSETS):
            if offset == CENTRE:
                continue
            for row in range(first, last):
                if table[offset, row] >= 0:
                    start = row_stride * (row - first)
                    for j in range(many[offset]):
                        child = children[offset, j]
                        add_run(onto, start + child * child_stride, products, at, width)
                        at += width

    return add
