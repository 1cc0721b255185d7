from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcc_networks.entropy_bottleneck import FrequencyTable
from pointkit.errors import InputError

Integers = NDArray[np.int32]
_ESCAPE_RANGE = 2**16
_WORD_BYTES = 4


def encode_latent(latent: Integers, tables: tuple[FrequencyTable, ...]) -> bytes:
    return encode_groups(zip(latent.T, tables, strict=True))


def decode_latent(data: bytes, count: int, tables: tuple[FrequencyTable, ...]) -> Integers:
    columns = decode_groups(data, [(count, table) for table in tables])
    return np.stack(columns, axis=1)


def encode_groups(groups: Iterable[tuple[Integers, FrequencyTable]]) -> bytes:
    """Encode groups of integers (n,), each group with a table.

    A value outside the table is coded as the escape symbol; the value, clipped to 16 bits, follows
    the group.
    """
    import constriction

    coder = constriction.stream.queue.RangeEncoder()
    for values, table in groups:
        escape = len(table.frequencies) - 1
        symbols = values.astype(np.int64) - table.lowest
        outside = (symbols < 0) | (symbols >= escape)
        coded = np.where(outside, escape, symbols).astype(np.int32)
        coder.encode(coded, _categorical(table))
        if outside.any():
            escaped = np.clip(values[outside] + _ESCAPE_RANGE // 2, 0, _ESCAPE_RANGE - 1)
            coder.encode(escaped.astype(np.int32), _escape_model())
    return bytes(coder.get_compressed().astype("<u4").tobytes())


def decode_groups(data: bytes, groups: Iterable[tuple[int, FrequencyTable]]) -> list[Integers]:
    with range_decoder(data, "features") as coder:
        return [_decode_group(coder, count, table) for count, table in groups]


@contextmanager
def range_decoder(data: bytes, part: str) -> Iterator[Any]:
    """Open a decoder; raise InputError if the data are damaged or not read to their end."""
    import constriction

    damaged = f"the stream is damaged ({part})"
    if len(data) % _WORD_BYTES:
        raise InputError(damaged)
    words = np.frombuffer(data, dtype="<u4").astype(np.uint32)
    coder = constriction.stream.queue.RangeDecoder(words)
    try:
        yield coder
    except (AssertionError, ValueError) as error:  # constriction's errors for impossible data
        raise InputError(damaged) from error
    if not coder.maybe_exhausted():
        raise InputError(damaged)


def _decode_group(coder: Any, count: int, table: FrequencyTable) -> Integers:
    escape = len(table.frequencies) - 1
    symbols: Integers = coder.decode(_categorical(table), count)
    values = symbols + np.int32(table.lowest)
    outside = symbols == escape
    if outside.any():
        escaped = coder.decode(_escape_model(), int(outside.sum()))
        values[outside] = escaped - _ESCAPE_RANGE // 2
    return values


def _categorical(table: FrequencyTable) -> Any:
    import constriction

    frequencies = table.frequencies.astype(np.float64)
    return constriction.stream.model.Categorical(frequencies, perfect=False)


def _escape_model() -> Any:
    import constriction

    return constriction.stream.model.Uniform(_ESCAPE_RANGE)
