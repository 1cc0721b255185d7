"""Entropy coding of the latent: constriction's range coder over the integer tables."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.pcgcv2.bottleneck import Table
from puckbench.errors import InputError

Integers = NDArray[np.int32]
_ESCAPE_RANGE = 2**16
_WORD = 4


def encode_latent(latent: Integers, tables: tuple[Table, ...]) -> bytes:
    """Code integers (n, channels), a channel after the other.

    Values outside a channel's table are escaped: the last symbol, then 16 bits each after the
    channel. Beyond 16 bits they are clipped.
    """
    import constriction

    coder = constriction.stream.queue.RangeEncoder()
    for values, table in zip(latent.T, tables, strict=True):
        escape = len(table.frequencies) - 1
        symbols = values.astype(np.int64) - table.lowest
        outside = (symbols < 0) | (symbols >= escape)
        coded = np.where(outside, escape, symbols).astype(np.int32)
        coder.encode(coded, _model(table))
        if outside.any():
            escaped = np.clip(values[outside] + _ESCAPE_RANGE // 2, 0, _ESCAPE_RANGE - 1)
            coder.encode(escaped.astype(np.int32), _escaped())
    return bytes(coder.get_compressed().astype("<u4").tobytes())


def decode_latent(data: bytes, count: int, tables: tuple[Table, ...]) -> Integers:
    """Integers (count, channels) of `encode_latent`; InputError when the data are damaged."""
    import constriction

    if len(data) % _WORD:
        raise InputError("the stream is damaged (features)")
    coder = constriction.stream.queue.RangeDecoder(
        np.frombuffer(data, dtype="<u4").astype(np.uint32)
    )
    latent = np.empty((count, len(tables)), dtype=np.int32)
    try:
        for values, table in zip(latent.T, tables, strict=True):
            escape = len(table.frequencies) - 1
            symbols = coder.decode(_model(table), count)
            values[:] = symbols + table.lowest
            outside = symbols == escape
            if outside.any():
                escaped = coder.decode(_escaped(), int(outside.sum()))
                values[outside] = escaped - _ESCAPE_RANGE // 2
    except (AssertionError, ValueError) as error:  # constriction's word for impossible data
        raise InputError("the stream is damaged (features)") from error
    if not coder.maybe_exhausted():
        raise InputError("the stream is damaged (features)")
    return latent


def _model(table: Table) -> Any:
    """constriction's model of a table; it rounds the frequencies alike on every machine."""
    import constriction

    frequencies = table.frequencies.astype(np.float64)
    return constriction.stream.model.Categorical(frequencies, perfect=False)


def _escaped() -> Any:
    import constriction

    return constriction.stream.model.Uniform(_ESCAPE_RANGE)
