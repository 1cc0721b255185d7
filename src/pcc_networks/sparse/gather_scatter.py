"""The two steps of a sparse convolution: features of neighbours are gathered, products are added.

Compiled loops for the CPU, and PyTorch's indexing for any device, give equal results. A `KernelMap`
says which kernel matrix connects each pair of voxels. There are two memory layouts. In the layout
*voxels*, a row is one voxel. In the layout *blocks*, a row is the eight children of a parent, which
leads to 27 larger matrix products. An offset between two parents connects 8 children of one parent
(zero offset), 4 (across a face), 2 (across an edge) or 1 (across a corner) with as many children of
the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pcc_networks.sparse.thread_pool import Scratch
from pcc_networks.sparse.voxels import CENTRE, OFFSETS
from pointkit.coding.intrinsics import add_floats, copy_floats
from pointkit.compiling import compiled


@dataclass(frozen=True)
class KernelMap:
    """For each of the 27 offsets between rows, the children that a convolution reads and writes."""

    children: int  # of a row: 1 (voxels) or 8 (blocks)
    counts: NDArray[np.int64]  # (27,), number of children read, and of children written
    read: NDArray[np.int64]  # (27, 8), children read; the first `counts` are in use
    written: NDArray[np.int64]  # (27, 8), children written
    # number of the kernel matrix from each child read to each child written, offset by offset
    kernel_of_pair: NDArray[np.int64]

    @cached_property
    def sizes(self) -> list[int]:
        """Number of children that are read at each offset."""
        sizes: list[int] = self.counts.tolist()
        return sizes

    @property
    def typical_read(self) -> int:
        """Typical number of children that a row reads from its neighbours."""
        # on a surface a row has about nine neighbours, half of all features that it could read
        return (sum(self.sizes) - self.children) // 2 or 1


@cache
def voxel_kernel_map() -> KernelMap:
    """Return the kernel map of rows that are single voxels."""
    children = np.zeros((OFFSETS, 8), dtype=np.int64)
    return KernelMap(1, np.ones(OFFSETS, np.int64), children, children, np.arange(OFFSETS))


@cache
def block_kernel_map() -> KernelMap:
    """Return the kernel map of rows that are the eight children of a parent."""
    read, written = np.zeros((2, OFFSETS, 8), dtype=np.int64)
    counts, kernels = np.zeros(OFFSETS, dtype=np.int64), []
    positions = np.arange(8)[:, None] >> np.arange(3) & 1
    for offset in range(OFFSETS):
        steps = offset // 3 ** np.arange(3) % 3 - 1
        is_read = ((steps == 0) | (positions == (steps < 0))).all(axis=1)
        sources = np.flatnonzero(is_read)
        targets = sources ^ (steps != 0) @ (1, 2, 4)  # on the other side of the common face
        count = counts[offset] = len(sources)
        read[offset, :count], written[offset, :count] = sources, targets
        distances = 2 * steps + positions[sources][:, None] - positions[targets]
        kernels.append((distances + 1) @ (1, 3, 9))
    return KernelMap(8, counts, read, written, np.concatenate([*map(np.ravel, kernels)]))


Flat = NDArray[np.float32]
Matrices = tuple[Tensor, ...]
"""Kernel matrix (count * c, count * d) of each offset, which connects `count` children."""
Segments = list[Tensor]
"""Features (m, count * channels) of the m pairs of rows of each offset."""


class NeighbourPairs(NamedTuple):
    """Pairs of a row and one of its neighbours, sorted by offset, then by row.

    A row is not a neighbour of itself.
    """

    firsts: NDArray[np.int64]  # (28,); offset k has the pairs firsts[k] to firsts[k + 1]
    rows: NDArray[np.int32]  # of each pair
    neighbours: NDArray[np.int32]  # row of the neighbour in each pair


class _Chunk(NamedTuple):
    firsts: NDArray[np.int64]  # (27,), first pair of each offset
    counts: NDArray[np.int64]  # (27,), pairs of each offset, 0 at the centre
    starts: NDArray[np.int64]  # (28,), first element of each offset in memory, for one channel

    def segments(self, buffer: Tensor, sizes: list[int], width: int) -> Segments:
        if max(sizes) == 1:  # one call for all offsets
            return list(buffer.view(-1, width).split_with_sizes(self.counts.tolist()))
        parts = buffer.split_with_sizes((np.diff(self.starts) * width).tolist())
        return [
            part.view(-1, children * width) for part, children in zip(parts, sizes, strict=True)
        ]


class CompiledGatherScatter:
    """Gathers and adds features on the CPU by compiled loops.

    Parameters
    ----------
    table
        Neighbour table (27, n), int32.
    kernel_map
        Whether a row holds one voxel or eight children.
    """

    def __init__(self, table: NDArray[np.int32], kernel_map: KernelMap) -> None:
        self._pairs, self.kernel_map = _pairs_of(table), kernel_map
        self._chunks: dict[tuple[int, int], _Chunk] = {}

    def _chunk(self, rows: slice) -> _Chunk:
        key = (rows.start, rows.stop)
        if key not in self._chunks:
            firsts, counts = _pairs_of_rows(self._pairs, *key)
            starts = np.append(0, np.cumsum(counts * self.kernel_map.counts))
            self._chunks[key] = _Chunk(firsts, counts, starts)
        return self._chunks[key]

    def gather(
        self, features: Tensor, rows: slice, scratch: Scratch, at_output: bool = False
    ) -> Segments:
        """Gather the features of the neighbours of a chunk of rows.

        Parameters
        ----------
        features
            Features (n, children, channels) of all rows.
        rows
            The chunk.
        scratch
            Working memory of the thread.
        at_output
            Whether to gather the features of the rows themselves instead, at the children that the
            convolution writes.

        Returns
        -------
        list of Tensor
            For each offset, features (pairs, count * channels); empty at the zero offset.
        """
        width, name = features.shape[2], "own" if at_output else "read"
        chunk = self._chunk(rows)
        buffer = scratch.take(name, int(chunk.starts[-1]) * width)
        sources = self._pairs.rows if at_output else self._pairs.neighbours
        children = self.kernel_map.written if at_output else self.kernel_map.read
        _mover(width, is_gather=True)(
            *_flat(features), buffer.numpy(), chunk.starts, sources, 0, chunk.firsts, chunk.counts,
            self.kernel_map.counts, children,
        )  # fmt: skip
        return chunk.segments(buffer, self.kernel_map.sizes, width)

    def add_products(
        self, features: Tensor, matrices: Matrices, rows: slice, scratch: Scratch, sums: Tensor
    ) -> None:
        """Multiply the features of neighbours by the matrix of each offset, and add them to `sums`.

        Parameters
        ----------
        features
            Features (n, children, c) of all rows.
        matrices
            Matrix (count * c, count * d) of each offset.
        rows
            The chunk of rows to compute.
        scratch
            Working memory of the thread.
        sums
            Sums (m, children, d) of the rows of the chunk.
        """
        width, chunk = sums.shape[2], self._chunk(rows)
        gathered = self.gather(features, rows, scratch)
        buffer = scratch.take("products", int(chunk.starts[-1]) * width)
        products = chunk.segments(buffer, self.kernel_map.sizes, width)
        for part, matrix, product in zip(gathered, matrices, products, strict=True):
            if len(part):
                torch.mm(part, matrix, out=product)
        _mover(width, is_gather=False)(
            *_flat(sums), buffer.numpy(), chunk.starts, self._pairs.rows, rows.start, chunk.firsts,
            chunk.counts, self.kernel_map.counts, self.kernel_map.written,
        )  # fmt: skip


class TorchGatherScatter:
    """Gathers and adds features by PyTorch, on any device.

    The methods are those of `CompiledGatherScatter`.

    Parameters
    ----------
    table
        Neighbour table (27, n), int64, on the device.
    kernel_map
        Whether a row holds one voxel or eight children.
    """

    def __init__(self, table: Tensor, kernel_map: KernelMap) -> None:
        self.table, self.kernel_map = table, kernel_map
        self._chunks: dict[tuple[int, int], list[tuple[Tensor, Tensor]]] = {}

    def _pairs(self, rows: slice) -> list[tuple[Tensor, Tensor]]:
        key = (rows.start, rows.stop)
        if key not in self._chunks:
            table = self.table[:, rows]
            exists = table >= 0
            exists[CENTRE] = False
            offsets, chunk_rows = torch.nonzero(exists, as_tuple=True)
            counts = torch.bincount(offsets, minlength=OFFSETS).tolist()
            parts = (
                torch.split(rows_of_pairs, counts)
                for rows_of_pairs in (chunk_rows, table[offsets, chunk_rows])
            )
            self._chunks[key] = list(zip(*parts, strict=True))
        return self._chunks[key]

    def gather(
        self, features: Tensor, rows: slice, scratch: Scratch, at_output: bool = False
    ) -> Segments:
        """Gather features as `CompiledGatherScatter.gather` does."""
        gathered: Segments = []
        for offset, (chunk_rows, neighbours) in enumerate(self._pairs(rows)):
            children = (self.kernel_map.written if at_output else self.kernel_map.read)[
                offset, : self.kernel_map.sizes[offset]
            ]
            row_features = features[rows.start + chunk_rows if at_output else neighbours]
            gathered.append(row_features[:, children.tolist()].flatten(1))
        return gathered

    def add_products(
        self, features: Tensor, matrices: Matrices, rows: slice, scratch: Scratch, sums: Tensor
    ) -> None:
        """Add products as `CompiledGatherScatter.add_products` does."""
        gathered = self.gather(features, rows, scratch)
        for offset, (chunk_rows, _) in enumerate(self._pairs(rows)):
            count = self.kernel_map.sizes[offset]
            children = torch.from_numpy(self.kernel_map.written[offset, :count]).to(sums.device)
            products = (gathered[offset] @ matrices[offset]).view(-1, count, sums.shape[2])
            sums[chunk_rows[:, None], children] += products


GatherScatter = CompiledGatherScatter | TorchGatherScatter


def _flat(features: Tensor) -> tuple[Any, int, int]:
    flat = features.as_strided((_elements_after(features),), (1,), features.storage_offset())
    return flat.numpy(), features.stride(0), features.stride(1)


def _elements_after(features: Tensor) -> int:
    return int(features.untyped_storage().nbytes() // 4 - features.storage_offset())


@cache
def _mover(width: int, is_gather: bool) -> Callable[..., None]:
    """Compile a loop that copies features to `packed`, or adds `packed` to features."""

    @compiled
    def move(
        features: Flat, row_stride: int, child_stride: int, packed: Flat,
        starts: NDArray[np.int64], rows: NDArray[np.int32], first_row: int,
        firsts: NDArray[np.int64], pair_counts: NDArray[np.int64],
        child_counts: NDArray[np.int64], children: NDArray[np.int64],
    ) -> None:  # fmt: skip
        for offset in range(OFFSETS):
            at = starts[offset] * width
            for pair in range(firsts[offset], firsts[offset] + pair_counts[offset]):
                start = row_stride * (rows[pair] - first_row)
                for j in range(child_counts[offset]):
                    place = start + children[offset, j] * child_stride
                    if is_gather:
                        copy_floats(packed, at, features, place, width)
                    else:
                        add_floats(features, place, packed, at, width)
                    at += width

    return move


@compiled
def _pairs_of(table: NDArray[np.int32]) -> NeighbourPairs:
    firsts = np.zeros(OFFSETS + 1, np.int64)
    for offset in range(OFFSETS):
        present = 0 if offset == CENTRE else (table[offset] >= 0).sum()
        firsts[offset + 1] = firsts[offset] + present
    rows, neighbours = np.empty(firsts[-1] + 1, np.int32), np.empty(firsts[-1] + 1, np.int32)
    for offset in range(OFFSETS):
        at = firsts[offset]
        if at < firsts[offset + 1]:
            for row in range(table.shape[1]):  # without a branch that cannot be foreseen
                rows[at], neighbours[at] = row, table[offset, row]
                at += table[offset, row] >= 0
    return NeighbourPairs(firsts, rows[:-1], neighbours[:-1])


@compiled
def _pairs_of_rows(
    pairs: NeighbourPairs, first: int, last: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first pair and the number of pairs of rows in [first, last), for each offset."""
    firsts, counts = np.empty(OFFSETS, np.int64), np.empty(OFFSETS, np.int64)
    for offset in range(OFFSETS):
        of_offset = pairs.rows[pairs.firsts[offset] : pairs.firsts[offset + 1]]
        low, high = np.searchsorted(of_offset, first), np.searchsorted(of_offset, last)
        firsts[offset], counts[offset] = pairs.firsts[offset] + low, high - low
    return firsts, counts
