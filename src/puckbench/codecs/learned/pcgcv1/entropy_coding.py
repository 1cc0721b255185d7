"""Entropy coding of a block of cubes: hyper-latents, latents, and how many voxels to keep."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.entropy_bottleneck import Table
from puckbench.codecs.learned.pcgcv1.laplace import PLACES, SCALES, Chosen, table
from puckbench.codecs.learned.range_coding import (
    decode_groups,
    decode_latent,
    encode_groups,
    encode_latent,
)
from puckbench.core.errors import InputError

Integers = NDArray[np.int32]
Bools = NDArray[np.bool_]
_WORD = 4


def encode_hyper(hyper: Integers, where: Bools, tables: tuple[Table, ...]) -> bytes:
    """Hyper-latents (cubes, channels, s, s, s), channel by channel, where `where` holds.

    where: (cubes, s, s, s).
    """
    return encode_latent(np.moveaxis(hyper, 1, -1)[where], tables)


def decode_hyper(data: bytes, where: Bools, tables: tuple[Table, ...]) -> Integers:
    """Hyper-latents as they were, zeros elsewhere; InputError when damaged."""
    whole = np.zeros((*where.shape, len(tables)), dtype=np.int32)
    whole[where] = decode_latent(data, int(where.sum()), tables)
    return np.ascontiguousarray(np.moveaxis(whole, -1, 1))


def encode_conditional(latent: Integers, chosen: Chosen) -> bytes:
    """Integers of any shape with the tables chosen for them, a table after the other."""
    order, sizes = _by_table(chosen)
    values = (latent - chosen.centre).ravel()[order]
    ends = np.cumsum([size for _, size in sizes])
    parts = np.split(values, ends[:-1])
    return encode_groups(
        (part, table(number)) for part, (number, _) in zip(parts, sizes, strict=True)
    )


def decode_conditional(data: bytes, chosen: Chosen) -> Integers:
    """The integers of `encode_conditional`; InputError when damaged."""
    order, sizes = _by_table(chosen)
    parts = decode_groups(data, [(size, table(number)) for number, size in sizes])
    values = np.empty(len(order), dtype=np.int32)
    values[order] = np.concatenate(parts)
    whole: Integers = values.reshape(chosen.centre.shape) + chosen.centre
    return whole


def _by_table(chosen: Chosen) -> tuple[NDArray[np.intp], list[tuple[int, int]]]:
    """Values in the order of their tables, and for each table in use its number and its values."""
    tables = chosen.table.ravel()
    sizes = np.bincount(tables, minlength=SCALES * PLACES)
    used = np.flatnonzero(sizes)
    return np.argsort(tables, kind="stable"), [(int(k), int(sizes[k])) for k in used]


def checksum(chosen: Chosen) -> int:
    """Of the tables chosen for a block: a decoder that chose others must stop."""
    return zlib.crc32(chosen.centre.tobytes(), zlib.crc32(chosen.table.tobytes()))


def encode_counts(counts: Iterable[int], most: int) -> bytes:
    """Whole numbers from 1 to `most`: length in bits by an adaptive model, then the bits."""
    import constriction

    coder = constriction.stream.queue.RangeEncoder()
    lengths = _Lengths(most)
    for count in counts:
        length = int(count).bit_length()
        coder.encode(length - 1, lengths.model())
        if length > 1:
            coder.encode(int(count) - (1 << length - 1), _uniform(length))
        lengths.seen(length - 1)
    return bytes(coder.get_compressed().astype("<u4").tobytes())


def decode_counts(data: bytes, number: int, most: int) -> list[int]:
    """The whole numbers of `encode_counts`; InputError when damaged."""
    import constriction

    if len(data) % _WORD:
        raise InputError("the stream is damaged (counts)")
    words = np.frombuffer(data, dtype="<u4").astype(np.uint32)
    coder = constriction.stream.queue.RangeDecoder(words)
    try:
        counts = list(_counts(coder, number, most))
    except (AssertionError, ValueError) as error:  # constriction's word for impossible data
        raise InputError("the stream is damaged (counts)") from error
    if not coder.maybe_exhausted() or max(counts, default=1) > most:
        raise InputError("the stream is damaged (counts)")
    return counts


def _counts(coder: Any, number: int, most: int) -> Iterator[int]:
    lengths = _Lengths(most)
    for _ in range(number):
        length = int(coder.decode(lengths.model())) + 1
        low = int(coder.decode(_uniform(length))) if length > 1 else 0
        lengths.seen(length - 1)
        yield (1 << length - 1) + low


class _Lengths:
    """How often each length in bits was seen so far."""

    def __init__(self, most: int) -> None:
        self.seen_times = np.ones(most.bit_length(), dtype=np.float64)

    def model(self) -> Any:
        import constriction

        return constriction.stream.model.Categorical(self.seen_times, perfect=False)

    def seen(self, length: int) -> None:
        self.seen_times[length] += 4


def _uniform(length: int) -> Any:
    import constriction

    return constriction.stream.model.Uniform(1 << length - 1)
