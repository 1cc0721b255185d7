from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcc_networks.adaptive_entropy import (
    Prior,
    decode_with_contexts,
    encode_with_contexts,
    prior_of,
)
from pcc_networks.entropy_bottleneck import (
    FrequencyTable,
    decode_groups,
    decode_latent,
    encode_groups,
    encode_latent,
    range_decoder,
)
from pcc_networks.pcgcv1.cubes import Bools, CodedCubes, Int64s
from pcc_networks.pcgcv1.hyper_prior import OFFSETS, SCALES, TableIndexes, laplace_table
from pcc_networks.sparse.voxels import AXIS_BITS, NeighbourTable, morton_keys, pyramid

Integers = NDArray[np.int32]
_MAX_POSITIONS = 2**20
"""Maximum positions of the latent for context mixing; each takes about 500 bytes of memory."""
_INCREMENT = 4
"""Amount by which a bit length's frequency (initially 1) grows when it is coded."""


def encode_hyper(z_hat: Integers, is_coded: Bools, tables: tuple[FrequencyTable, ...]) -> bytes:
    """Encode the hyper-latents of cubes.

    Parameters
    ----------
    z_hat
        Integers (cubes, channels, s, s, s).
    is_coded
        Mask (cubes, s, s, s) of the positions that are coded.
    tables
        Frequency table of each channel.
    """
    return encode_latent(np.moveaxis(z_hat, 1, -1)[is_coded], tables)


def decode_hyper(data: bytes, is_coded: Bools, tables: tuple[FrequencyTable, ...]) -> Integers:
    """Decode the hyper-latents (cubes, channels, s, s, s) of cubes; they are 0 where not coded."""
    z_hat = np.zeros((*is_coded.shape, len(tables)), dtype=np.int32)
    z_hat[is_coded] = decode_latent(data, int(is_coded.sum()), tables)
    return np.ascontiguousarray(np.moveaxis(z_hat, -1, 1))


class LatentPositions(NamedTuple):
    """The positions in all cubes at which the latent is coded with context mixing."""

    order: Int64s  # (n,), from the order of cubes to Morton order
    neighbours: NeighbourTable  # (27, n), in Morton order


def encode_conditional(
    y_hat: Integers, indexes: TableIndexes, positions: LatentPositions | None = None
) -> bytes:
    """Encode a latent whose distributions depend on the hyper-latent.

    Parameters
    ----------
    y_hat
        Integers (n, channels); any shape is allowed without `positions`.
    indexes
        Frequency table and centre of each value.
    positions
        Positions of the rows, if adaptive contexts shall be mixed with the tables.
    """
    if positions is not None:
        prior = _prior(indexes, positions.order)
        return encode_with_contexts(y_hat[positions.order], positions.neighbours, prior)
    order, sizes = _by_table(indexes)
    values = (y_hat - indexes.centre).ravel()[order]
    parts = np.split(values, np.cumsum([size for _, size in sizes])[:-1])
    return encode_groups(
        (part, laplace_table(number)) for part, (number, _) in zip(parts, sizes, strict=True)
    )


def decode_conditional(
    data: bytes, indexes: TableIndexes, positions: LatentPositions | None = None
) -> Integers:
    """Decode the latent that `encode_conditional` encoded with the same indexes and positions.

    Raises InputError if the data are damaged.
    """
    y_hat = np.empty(indexes.table.shape, np.int32)
    if positions is not None:
        prior = _prior(indexes, positions.order)
        y_hat[positions.order] = decode_with_contexts(data, positions.neighbours, prior)
        return y_hat
    order, sizes = _by_table(indexes)
    parts = decode_groups(data, [(size, laplace_table(number)) for number, size in sizes])
    y_hat.ravel()[order] = np.concatenate(parts)
    return np.asarray(y_hat + indexes.centre)


def _by_table(indexes: TableIndexes) -> tuple[NDArray[np.intp], list[tuple[int, int]]]:
    tables = indexes.table.ravel()
    sizes = np.bincount(tables, minlength=SCALES * OFFSETS)
    used = np.flatnonzero(sizes)
    return np.argsort(tables, kind="stable"), [(int(k), int(sizes[k])) for k in used]


def latent_positions(support: CodedCubes) -> LatentPositions | None:
    """Return the positions at which the latent of cubes is coded.

    The result is None if context mixing is impossible, because there are no positions, too many
    positions, or positions too far apart.
    """
    cube, *inside = np.nonzero(support.blocks)
    if not 0 < len(cube) <= _MAX_POSITIONS:
        return None
    corners = support.positions - support.positions.min(axis=0)
    positions = corners[cube] * support.blocks.shape[-1] + np.column_stack(inside)
    if positions.max() >= 2**AXIS_BITS:
        return None
    keys = morton_keys(positions)
    order = np.argsort(keys)
    return LatentPositions(order, pyramid(keys[order], 0)[0][0].neighbours)


def _prior(indexes: TableIndexes, order: Int64s) -> Prior:
    used, number = np.unique(indexes.table[order], return_inverse=True)
    tables = tuple(map(laplace_table, used.tolist()))
    return prior_of(tables, number.reshape(indexes.table.shape), indexes.centre[order])


def checksum(indexes: TableIndexes) -> int:
    """Return the CRC-32 of table indexes, by which a decoder detects different results."""
    return zlib.crc32(indexes.centre.tobytes(), zlib.crc32(indexes.table.tobytes()))


def encode_counts(counts: Iterable[int], max_value: int) -> bytes:
    """Encode integers from 1 to `max_value`.

    The bit length of each integer is coded with adaptive frequencies; its lower bits follow.
    """
    import constriction

    coder = constriction.stream.queue.RangeEncoder()
    frequencies = np.ones(max_value.bit_length())
    for count in counts:
        length = int(count).bit_length()
        coder.encode(length - 1, _adaptive(frequencies))
        if length > 1:
            coder.encode(int(count) - (1 << length - 1), _uniform(length))
        frequencies[length - 1] += _INCREMENT
    return bytes(coder.get_compressed().astype("<u4").tobytes())


def decode_counts(data: bytes, number: int, max_value: int) -> list[int]:
    """Decode the `number` integers that `encode_counts` encoded.

    Raises InputError if the data are damaged.
    """
    counts, frequencies = [], np.ones(max_value.bit_length())
    with range_decoder(data, "counts") as coder:
        for _ in range(number):
            length = int(coder.decode(_adaptive(frequencies))) + 1
            low = int(coder.decode(_uniform(length))) if length > 1 else 0
            frequencies[length - 1] += _INCREMENT
            counts.append((1 << length - 1) + low)
        if max(counts, default=1) > max_value:
            raise ValueError("a count is too large")
    return counts


def _adaptive(frequencies: NDArray[np.float64]) -> Any:
    import constriction

    return constriction.stream.model.Categorical(frequencies, perfect=False)


def _uniform(length: int) -> Any:
    import constriction

    return constriction.stream.model.Uniform(1 << length - 1)
