"""Entropy coding of PCGCv1: hyper-latent, latent given its distributions, and voxel counts."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.learned.adaptive_entropy import (
    Prior,
    decode_with_contexts,
    encode_with_contexts,
)
from puckbench.learned.entropy_bottleneck import FrequencyTable
from puckbench.learned.pcgcv1.cubes import Whole
from puckbench.learned.pcgcv1.laplace import OFFSETS, SCALES, TableIndexes, laplace_table
from puckbench.learned.pcgcv1.occupied_blocks import Bools, CodedCubes
from puckbench.learned.range_coding import (
    decode_groups,
    decode_latent,
    encode_groups,
    encode_latent,
    range_decoder,
)
from puckbench.learned.sparse.voxels import AXIS_BITS, NeighbourTable, morton_keys, pyramid

Integers = NDArray[np.int32]
_MAX_POSITIONS = 2**20
"""Positions of the latent in one context model, each of which takes some 500 bytes of memory."""


def encode_hyper(z_hat: Integers, where: Bools, tables: tuple[FrequencyTable, ...]) -> bytes:
    """Code hyper-latents, channel by channel.

    Parameters
    ----------
    z_hat
        (cubes, channels, s, s, s).
    where
        (cubes, s, s, s), the positions that are coded.
    tables
        Of the channels.
    """
    return encode_latent(np.moveaxis(z_hat, 1, -1)[where], tables)


def decode_hyper(data: bytes, where: Bools, tables: tuple[FrequencyTable, ...]) -> Integers:
    """The hyper-latents of `encode_hyper`, zeros elsewhere; InputError when damaged."""
    whole = np.zeros((*where.shape, len(tables)), dtype=np.int32)
    whole[where] = decode_latent(data, int(where.sum()), tables)
    return np.ascontiguousarray(np.moveaxis(whole, -1, 1))


def encode_conditional(y_hat: Integers, indexes: TableIndexes) -> bytes:
    """Code integers of any shape with their tables, table by table."""
    order, sizes = _by_table(indexes)
    values = (y_hat - indexes.centre).ravel()[order]
    ends = np.cumsum([size for _, size in sizes])
    parts = np.split(values, ends[:-1])
    return encode_groups(
        (part, laplace_table(number)) for part, (number, _) in zip(parts, sizes, strict=True)
    )


def decode_conditional(data: bytes, indexes: TableIndexes) -> Integers:
    """The integers of `encode_conditional`; InputError when damaged."""
    order, sizes = _by_table(indexes)
    parts = decode_groups(data, [(size, laplace_table(number)) for number, size in sizes])
    values = np.empty(len(order), dtype=np.int32)
    values[order] = np.concatenate(parts)
    whole: Integers = values.reshape(indexes.centre.shape) + indexes.centre
    return whole


def _by_table(indexes: TableIndexes) -> tuple[NDArray[np.intp], list[tuple[int, int]]]:
    """Values in the order of their tables, and for each table in use its number and its values."""
    tables = indexes.table.ravel()
    sizes = np.bincount(tables, minlength=SCALES * OFFSETS)
    used = np.flatnonzero(sizes)
    return np.argsort(tables, kind="stable"), [(int(k), int(sizes[k])) for k in used]


@dataclass(frozen=True)
class LatentPositions:
    """The positions at which the latent of all cubes is coded, for context mixing.

    Parameters
    ----------
    order
        (n,), puts the positions, which come cube by cube, into Morton order.
    neighbours
        (27, n), table of neighbours in Morton order.
    """

    order: Whole
    neighbours: NeighbourTable

    def encode(self, y_hat: Integers, indexes: TableIndexes) -> bytes:
        """Code integers (n, channels), cube by cube, given their tables."""
        prior = _prior(indexes, self.order)
        return encode_with_contexts(y_hat[self.order], self.neighbours, prior)

    def decode(self, data: bytes, indexes: TableIndexes) -> Integers:
        """The integers (n, channels) of `encode`; InputError when the data are damaged."""
        y_hat = np.empty(indexes.table.shape, np.int32)
        prior = _prior(indexes, self.order)
        y_hat[self.order] = decode_with_contexts(data, self.neighbours, prior)
        return y_hat


def latent_positions(support: CodedCubes) -> LatentPositions | None:
    """The positions in cubes; None if there are none, too many, or too far apart for their keys."""
    cube, *inside = np.nonzero(support.blocks)
    if not 0 < len(cube) <= _MAX_POSITIONS:
        return None
    corners = support.positions - support.positions.min(axis=0)
    places = corners[cube] * support.blocks.shape[-1] + np.column_stack(inside)
    if places.max() >= 2**AXIS_BITS:
        return None
    keys = morton_keys(places)
    order = np.argsort(keys)
    return LatentPositions(order, pyramid(keys[order], 0)[0][0].neighbours)


def _prior(indexes: TableIndexes, order: Whole) -> Prior:
    used, number = np.unique(indexes.table[order], return_inverse=True)
    tables = tuple(map(laplace_table, used.tolist()))
    return Prior(tables, number.reshape(indexes.table.shape), indexes.centre[order])


def checksum(indexes: TableIndexes) -> int:
    """CRC-32 of the tables of a batch: a decoder with other ones must stop."""
    return zlib.crc32(indexes.centre.tobytes(), zlib.crc32(indexes.table.tobytes()))


def encode_counts(counts: Iterable[int], most: int) -> bytes:
    """Code integers from 1 to `most`: length in bits by an adaptive model, then the bits."""
    import constriction

    coder = constriction.stream.queue.RangeEncoder()
    lengths = _LengthStatistics(most)
    for count in counts:
        length = int(count).bit_length()
        coder.encode(length - 1, lengths.model())
        if length > 1:
            coder.encode(int(count) - (1 << length - 1), _uniform(length))
        lengths.update(length - 1)
    return bytes(coder.get_compressed().astype("<u4").tobytes())


def decode_counts(data: bytes, number: int, most: int) -> list[int]:
    """The integers of `encode_counts`; InputError when damaged."""
    with range_decoder(data, "counts") as coder:
        counts = list(_counts(coder, number, most))
        if max(counts, default=1) > most:
            raise ValueError("a count is too large")
    return counts


def _counts(coder: Any, number: int, most: int) -> Iterator[int]:
    lengths = _LengthStatistics(most)
    for _ in range(number):
        length = int(coder.decode(lengths.model())) + 1
        low = int(coder.decode(_uniform(length))) if length > 1 else 0
        lengths.update(length - 1)
        yield (1 << length - 1) + low


class _LengthStatistics:
    """Adaptive frequencies of the lengths in bits."""

    def __init__(self, most: int) -> None:
        self.frequencies = np.ones(most.bit_length(), dtype=np.float64)

    def model(self) -> Any:
        import constriction

        return constriction.stream.model.Categorical(self.frequencies, perfect=False)

    def update(self, length: int) -> None:
        self.frequencies[length] += 4


def _uniform(length: int) -> Any:
    import constriction

    return constriction.stream.model.Uniform(1 << length - 1)
