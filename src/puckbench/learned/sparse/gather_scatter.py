"""Gathering the features of neighbours, and adding products to the rows they belong to.

There are two implementations with equal results: compiled loops for the CPU, and PyTorch's indexing
for any device.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.coding.vector_moves import add_vector, copy_vector
from puckbench.core.compiling import compiled
from puckbench.learned.sparse.kernel_map import KernelMap
from puckbench.learned.sparse.thread_pool import Scratch
from puckbench.learned.sparse.voxels import CENTRE, OFFSETS

Flat = NDArray[np.float32]
Segments = list[Tensor | None]
"""For each offset the features (m, count * channels) of its m pairs of rows; None if m is 0."""


class NeighbourPairs(NamedTuple):
    """The pairs of a row and its neighbour, offset by offset, by rising rows; none at the centre.

    Parameters
    ----------
    firsts
        (28,): the pairs of offset k are ``firsts[k]`` to ``firsts[k + 1]``.
    rows, others
        Of each pair the row, and the row of its neighbour.
    """

    firsts: NDArray[np.int64]
    rows: NDArray[np.int32]
    others: NDArray[np.int32]


@dataclass(frozen=True)
class PairLayout:
    """Where a chunk's pairs of rows stand in flat memory, offset by offset.

    Offsets that join equally many children stand side by side.

    Parameters
    ----------
    counts
        Number of pairs of each offset (27,); 0 at the centre.
    starts
        Where its pairs begin (27,), in features of one channel.
    size
        Where all end.
    groups
        Numbers of children, and the offsets that join so many with their counts; none without any.
    """

    counts: NDArray[np.int64]
    starts: NDArray[np.int64]
    size: int
    groups: list[tuple[int, list[int], list[int]]]


class GatherScatter(Protocol):
    """Gathers and scatters features between neighbouring rows, for a chunk of rows."""

    def layout(self, kernel_map: KernelMap, rows: slice) -> PairLayout:
        """Where the chunk's pairs stand in memory for `segments`."""

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


class _Chunk(NamedTuple):
    """First pair of each offset of a chunk of rows, and where its pairs stand in memory."""

    firsts: NDArray[np.int64]
    layout: PairLayout


class CompiledGatherScatter:
    """Compiled loops for tensors of the CPU, over a neighbour table (27, n) int32."""

    def __init__(self, table: NDArray[np.int32]) -> None:
        self._pairs = _pairs_of(table)
        self._chunks: dict[tuple[int, int, int], _Chunk] = {}

    def _chunk(self, kernel_map: KernelMap, rows: slice) -> _Chunk:
        """The chunk's pairs, which several layers ask for."""
        key = (rows.start, rows.stop, kernel_map.children)
        if key not in self._chunks:
            firsts, counts = _pairs_of_rows(self._pairs, rows.start, rows.stop)
            self._chunks[key] = _Chunk(firsts, layout_of(counts, kernel_map))
        return self._chunks[key]

    def layout(self, kernel_map: KernelMap, rows: slice) -> PairLayout:
        """As in `GatherScatter`."""
        return self._chunk(kernel_map, rows).layout

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
        chunk = self._chunk(kernel_map, rows)
        room = scratch.take(name, chunk.layout.size * width)
        _gatherer(width)(
            *_flat(features), self._pairs.rows if own else self._pairs.others, chunk.firsts,
            chunk.layout.counts, kernel_map.counts,
            kernel_map.written if own else kernel_map.read, room.numpy(), chunk.layout.starts,
        )  # fmt: skip
        return segments(room, chunk.layout, width)

    def scatter_add(
        self, products: Segments, onto: Tensor, kernel_map: KernelMap, rows: slice
    ) -> None:
        """As in `GatherScatter`; the products lie in memory as in `segments`."""
        found = next((products[k] for k in kernel_map.order if products[k] is not None), None)
        if found is not None:
            chunk = self._chunk(kernel_map, rows)
            size = chunk.layout.size * onto.shape[2]
            whole = found.as_strided((size,), (1,), found.storage_offset())
            _adder(onto.shape[2])(
                whole.numpy(), chunk.layout.starts, self._pairs.rows, chunk.firsts,
                chunk.layout.counts, rows.start, kernel_map.counts, kernel_map.written,
                *_flat(onto),
            )  # fmt: skip


class TorchGatherScatter:
    """For tensors of any device, over a neighbour table (27, n) int64 on it."""

    def __init__(self, table: Tensor) -> None:
        self.table = table
        self._chunks: dict[tuple[int, int], list[tuple[Tensor, Tensor]]] = {}

    def _pairs(self, rows: slice) -> list[tuple[Tensor, Tensor]]:
        """Rows of a chunk with a neighbour at each offset, and these neighbours."""
        key = (rows.start, rows.stop)
        if key not in self._chunks:
            table = self.table[:, rows]
            there = table >= 0
            there[CENTRE] = False
            offsets, inside = torch.nonzero(there, as_tuple=True)
            counts = torch.bincount(offsets, minlength=OFFSETS).tolist()
            parts = (torch.split(found, counts) for found in (inside, table[offsets, inside]))
            self._chunks[key] = list(zip(*parts, strict=True))
        return self._chunks[key]

    def layout(self, kernel_map: KernelMap, rows: slice) -> PairLayout:
        """As in `GatherScatter`."""
        return layout_of(np.array([len(inside) for inside, _ in self._pairs(rows)]), kernel_map)

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
        for offset, (inside, others) in enumerate(self._pairs(rows)):
            if len(inside) == 0:
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
                inside, _ = self._pairs(rows)[offset]
                children = torch.from_numpy(kernel_map.written[offset, : kernel_map.sizes[offset]])
                target = (inside[:, None], children.to(inside.device)[None, :])
                onto[target] = onto[target] + product.view(len(inside), len(children), -1)


def layout_of(counts: NDArray[np.int64], kernel_map: KernelMap) -> PairLayout:
    """The layout of a chunk with so many pairs of rows at each offset (27,)."""
    sizes = (counts * kernel_map.counts)[kernel_map.order]
    ends, starts = np.cumsum(sizes), np.empty_like(counts)
    starts[kernel_map.order] = ends - sizes
    pairs, groups = counts.tolist(), []
    for children, offsets in kernel_map.groups:
        present = [offset for offset in offsets if pairs[offset]]
        groups.append((children, present, [pairs[offset] for offset in present]))
    return PairLayout(counts, starts, int(ends[-1]), groups)


def segments(room: Tensor, layout: PairLayout, width: int) -> Segments:
    """Views of flat memory as the pairs of rows of each offset."""
    found: Segments = [None] * OFFSETS
    at = 0
    for children, offsets, pairs in layout.groups:
        end = at + sum(pairs) * children * width
        parts = room[at:end].view(-1, children * width).split_with_sizes(pairs)
        for offset, part in zip(offsets, parts, strict=True):
            found[offset] = part
        at = end
    return found


def _flat(features: Tensor) -> tuple[Any, int, int]:
    """Flat memory from the first feature on, and the strides of rows and children in it."""
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
        sources: NDArray[np.int32],
        firsts: NDArray[np.int64],
        pair_counts: NDArray[np.int64],
        child_counts: NDArray[np.int64],
        children: NDArray[np.int64],
        into: Flat,
        starts: NDArray[np.int64],
    ) -> None:
        for offset in range(OFFSETS):
            at = starts[offset] * width
            for pair in range(firsts[offset], firsts[offset] + pair_counts[offset]):
                start = row_stride * sources[pair]
                for j in range(child_counts[offset]):
                    origin = start + children[offset, j] * child_stride
                    copy_vector(into, at, features, origin, width)
                    at += width

    return gather


@cache
def _adder(width: int) -> Callable[..., None]:
    @compiled
    def add(
        products: Flat,
        starts: NDArray[np.int64],
        rows: NDArray[np.int32],
        firsts: NDArray[np.int64],
        pair_counts: NDArray[np.int64],
        first_row: int,
        child_counts: NDArray[np.int64],
        children: NDArray[np.int64],
        onto: Flat,
        row_stride: int,
        child_stride: int,
    ) -> None:
        for offset in range(OFFSETS):
            at = starts[offset] * width
            for pair in range(firsts[offset], firsts[offset] + pair_counts[offset]):
                start = row_stride * (rows[pair] - first_row)
                for j in range(child_counts[offset]):
                    target = start + children[offset, j] * child_stride
                    add_vector(onto, target, products, at, width)
                    at += width

    return add


@compiled
def _pairs_of(table: NDArray[np.int32]) -> NeighbourPairs:
    firsts = np.zeros(OFFSETS + 1, np.int64)
    for offset in range(OFFSETS):
        present = 0 if offset == CENTRE else (table[offset] >= 0).sum()
        firsts[offset + 1] = firsts[offset] + present
    rows, others = np.empty(firsts[-1] + 1, np.int32), np.empty(firsts[-1] + 1, np.int32)
    for offset in range(OFFSETS):
        at = firsts[offset]
        if at < firsts[offset + 1]:
            for row in range(table.shape[1]):  # without a branch that cannot be foreseen
                rows[at], others[at] = row, table[offset, row]
                at += table[offset, row] >= 0
    return NeighbourPairs(firsts, rows[:-1], others[:-1])


@compiled
def _pairs_of_rows(
    pairs: NeighbourPairs, first: int, last: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First pair and number of pairs of each offset (27,) whose rows are in [first, last)."""
    firsts, counts = np.empty(OFFSETS, np.int64), np.empty(OFFSETS, np.int64)
    for offset in range(OFFSETS):
        of_offset = pairs.rows[pairs.firsts[offset] : pairs.firsts[offset + 1]]
        low, high = np.searchsorted(of_offset, first), np.searchsorted(of_offset, last)
        firsts[offset], counts[offset] = pairs.firsts[offset] + low, high - low
    return firsts, counts
