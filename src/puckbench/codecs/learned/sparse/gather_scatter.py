"""Gathering the features of neighbours, and adding products to the rows they belong to.

There are two implementations with equal results: compiled loops for the CPU, and PyTorch's indexing
for any device.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.codecs.learned.sparse.kernel_map import KernelMap
from puckbench.codecs.learned.sparse.thread_pool import Scratch
from puckbench.codecs.learned.sparse.voxels import CENTRE, OFFSETS
from puckbench.core.compiling import compiled, inlined

Flat = NDArray[np.float32]
Segments = list[Tensor | None]
"""For each offset the features (m, count * channels) of its m pairs of rows; None if m is 0."""


class GatherScatter(Protocol):
    """Gathers and scatters features between neighbouring rows, for a chunk of rows."""

    def gather(
        self,
        features: Tensor,
        kernel_map: KernelMap,
        rows: slice,
        scratch: Scratch,
        own: bool = False,
    ) -> Segments:
        """The features that rows read from their neighbours at each offset but the centre.

        Parameters
        ----------
        features
            (n, children, channels).
        kernel_map
            Which children are read and written.
        rows
            The chunk.
        scratch
            Working memory.
        own
            Gather the children that the row itself writes instead.
        """

    def scatter_add(
        self, products: Segments, onto: Tensor, kernel_map: KernelMap, rows: slice
    ) -> None:
        """Add products to the written children in `onto` (rows, children, channels)."""


class CompiledGatherScatter:
    """Compiled loops for tensors of the CPU, over a neighbour table (27, n) int32."""

    def __init__(self, table: NDArray[np.int32]) -> None:
        self.table = table

    def gather(
        self,
        features: Tensor,
        kernel_map: KernelMap,
        rows: slice,
        scratch: Scratch,
        own: bool = False,
    ) -> Segments:
        """As in `GatherScatter`."""
        width, name = features.shape[2], "own" if own else "read"
        room = scratch.take(name, (rows.stop - rows.start) * kernel_map.max_read * width)
        counts = np.zeros(OFFSETS, dtype=np.int64)
        _gatherer(width)(
            *_flat(features), self.table, rows.start, rows.stop, kernel_map.counts,
            kernel_map.written if own else kernel_map.read, own, room.numpy(), counts,
        )  # fmt: skip
        return segments(room, counts, kernel_map, width)

    def scatter_add(
        self, products: Segments, onto: Tensor, kernel_map: KernelMap, rows: slice
    ) -> None:
        """As in `GatherScatter`; the products are contiguous in memory, as in `segments`."""
        found = next((part for part in products if part is not None), None)
        if found is not None:
            whole = found.as_strided((_after(found),), (1,), found.storage_offset())
            _adder(onto.shape[2])(
                whole.numpy(), self.table, rows.start, rows.stop, kernel_map.counts,
                kernel_map.written, *_flat(onto),
            )  # fmt: skip


class TorchGatherScatter:
    """For tensors of any device, over a neighbour table (27, n) int64 on it."""

    def __init__(self, table: Tensor) -> None:
        self.table = table

    def _pairs(self, offset: int, rows: slice) -> tuple[Tensor, Tensor]:
        others = self.table[offset, rows]
        inside = torch.nonzero(others >= 0)[:, 0]
        return inside, others[inside]

    def gather(
        self,
        features: Tensor,
        kernel_map: KernelMap,
        rows: slice,
        scratch: Scratch,
        own: bool = False,
    ) -> Segments:
        """As in `GatherScatter`."""
        found: Segments = []
        for offset in range(OFFSETS):
            inside, others = self._pairs(offset, rows)
            if offset == CENTRE or len(inside) == 0:
                found.append(None)
                continue
            children = (kernel_map.written if own else kernel_map.read)[
                offset, : kernel_map.sizes[offset]
            ]
            chosen = features[rows.start + inside if own else others]
            found.append(chosen[:, children.tolist()].flatten(1))
        return found

    def scatter_add(
        self, products: Segments, onto: Tensor, kernel_map: KernelMap, rows: slice
    ) -> None:
        """As in `GatherScatter`."""
        for offset, product in enumerate(products):
            if product is not None:
                inside, _ = self._pairs(offset, rows)
                children = torch.from_numpy(kernel_map.written[offset, : kernel_map.sizes[offset]])
                target = (inside[:, None], children.to(inside.device)[None, :])
                onto[target] = onto[target] + product.view(len(inside), len(children), -1)


def segments(
    room: Tensor, counts: NDArray[np.int64], kernel_map: KernelMap, width: int
) -> Segments:
    """Views of flat memory as the pairs of rows of each offset, one after the other."""
    found: Segments = []
    at = 0
    for pairs, count in zip(counts.tolist(), kernel_map.sizes, strict=True):
        size = pairs * count * width
        found.append(room[at : at + size].view(pairs, count * width) if pairs else None)
        at += size
    return found


def _flat(features: Tensor) -> tuple[Any, int, int]:
    """Flat memory from the first feature on, and the strides of rows and children in it."""
    flat = features.as_strided((_after(features),), (1,), features.storage_offset())
    return flat.numpy(), features.stride(0), features.stride(1)


def _after(features: Tensor) -> int:
    """Elements of the memory from the tensor's first one on."""
    return int(features.untyped_storage().nbytes() // 4 - features.storage_offset())


# Unsigned indices spare the compiler the check for negative ones.
@inlined
def _copy(onto: Flat, i: int, source: Flat, j: int, length: int) -> None:
    """``onto[i : i + length] = source[j : j + length]``, unchecked."""
    start, origin = np.uint64(i), np.uint64(j)
    for k in range(np.uint64(length)):
        onto[start + np.uint64(k)] = source[origin + np.uint64(k)]


@inlined
def _add(onto: Flat, i: int, source: Flat, j: int, length: int) -> None:
    """``onto[i : i + length] += source[j : j + length]``, unchecked."""
    start, origin = np.uint64(i), np.uint64(j)
    for k in range(np.uint64(length)):
        onto[start + np.uint64(k)] += source[origin + np.uint64(k)]


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
        child_counts: NDArray[np.int64],
        children: NDArray[np.int64],
        own: bool,
        into: Flat,
        pair_counts: NDArray[np.int64],
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
                    for j in range(child_counts[offset]):
                        child = children[offset, j]
                        _copy(into, at, features, start + child * child_stride, width)
                        at += width
            pair_counts[offset] = pairs

    return gather


@cache
def _adder(width: int) -> Callable[..., None]:
    @compiled
    def add(
        products: Flat,
        table: NDArray[np.int32],
        first: int,
        last: int,
        child_counts: NDArray[np.int64],
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
                    for j in range(child_counts[offset]):
                        child = children[offset, j]
                        _add(onto, start + child * child_stride, products, at, width)
                        at += width

    return add
