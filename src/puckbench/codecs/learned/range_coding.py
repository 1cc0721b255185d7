"""Entropy coding of the latent: constriction's range coder over the integer tables."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.entropy_bottleneck import Table
from puckbench.core.errors import InputError

Integers = NDArray[np.int32]
_ESCAPE_RANGE = 2**16
_WORD = 4


def encode_latent(latent: Integers, tables: tuple[Table, ...]) -> bytes:
    """Code integers (n, channels), a channel after the other."""
    return encode_groups(zip(latent.T, tables, strict=True))


def decode_latent(data: bytes, count: int, tables: tuple[Table, ...]) -> Integers:
    """Integers (count, channels) of `encode_latent`; InputError when the data are damaged."""
    columns = decode_groups(data, [(count, table) for table in tables])
    return np.stack(columns, axis=1)


def encode_groups(groups: Iterable[tuple[Integers, Table]]) -> bytes:
    """Code groups of integers (n,), each with a table of its own.

    Values outside a group's table are escaped: the last symbol, then 16 bits each after the
    group. Beyond 16 bits they are clipped.
    """
    import constriction

    coder = constriction.stream.queue.RangeEncoder()
    for values, table in groups:
        escape = len(table.frequencies) - 1
        symbols = values.astype(np.int64) - table.lowest
        outside = (symbols < 0) | (symbols >= escape)
        coded = np.where(outside, escape, symbols).astype(np.int32)
        coder.encode(coded, _model(table))
        if outside.any():
            escaped = np.clip(values[outside] + _ESCAPE_RANGE // 2, 0, _ESCAPE_RANGE - 1)
            coder.encode(escaped.astype(np.int32), _escaped())
    return bytes(coder.get_compressed().astype("<u4").tobytes())


def decode_groups(data: bytes, groups: Iterable[tuple[int, Table]]) -> list[Integers]:
    """The groups of `encode_groups`, of given sizes; InputError when the data are damaged."""
    import constriction

    if len(data) % _WORD:
        raise InputError("the stream is damaged (features)")
    words = np.frombuffer(data, dtype="<u4").astype(np.uint32)
    coder = constriction.stream.queue.RangeDecoder(words)
    try:
        decoded = [_decode_group(coder, count, table) for count, table in groups]
    except (AssertionError, ValueError) as error:  # constriction's word for impossible data
        raise InputError("the stream is damaged (features)") from error
    if not coder.maybe_exhausted():
        raise InputError("the stream is damaged (features)")
    return decoded


def _decode_group(coder: Any, count: int, table: Table) -> Integers:
    escape = len(table.frequencies) - 1
    symbols: Integers = coder.decode(_model(table), count)
    values = symbols + np.int32(table.lowest)
    outside = symbols == escape
    if outside.any():
        escaped = coder.decode(_escaped(), int(outside.sum()))
        values[outside] = escaped - _ESCAPE_RANGE // 2
    return values


def _model(table: Table) -> Any:
    """constriction's model of a table; it rounds the frequencies alike on every machine."""
    import constriction

    frequencies = table.frequencies.astype(np.float64)
    return constriction.stream.model.Categorical(frequencies, perfect=False)


def _escaped() -> Any:
    import constriction

    return constriction.stream.model.Uniform(_ESCAPE_RANGE)
