"""TensorFlow checkpoints read without TensorFlow: the variables of an index and its one data file.

The index is a LevelDB table, uncompressed as TensorFlow writes it, of names and `BundleEntryProto`
messages: type, shape, and the place of the values in the data file.

References
----------
tensorflow/core/util/tensor_bundle and tensorflow/core/lib/io/format.cc of TensorFlow 1.13.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError

_SUFFIX = "/.ATTRIBUTES/VARIABLE_VALUE"
_SLOT = "/.OPTIMIZER_SLOT/"
_FLOAT = 1
_FOOTER = 48
_TYPE, _SHAPE, _OFFSET, _SIZE = 1, 2, 4, 5
"""Fields of a `BundleEntryProto`."""


def variables_of(index: bytes, data: bytes) -> dict[str, NDArray[np.float32]]:
    """The variables of single precision in a checkpoint by name, without an optimiser's slots.

    Raises
    ------
    InputError
        The bytes are not those of a checkpoint.
    """
    try:
        return dict(_variables(index, data))
    except (IndexError, KeyError, TypeError, ValueError, struct.error) as error:
        raise InputError("not a TensorFlow checkpoint") from error


def _variables(index: bytes, data: bytes) -> Iterator[tuple[str, NDArray[np.float32]]]:
    for key, value in _rows(index):
        fields = _fields(value)
        name = key.decode()
        if _SLOT in name or not name.endswith(_SUFFIX) or fields.get(_TYPE) != [_FLOAT]:
            continue
        start, size = (fields.get(field, [0])[0] for field in (_OFFSET, _SIZE))
        shape = [_fields(each)[1][0] for each in _fields(fields[_SHAPE][0]).get(2, [])]
        values = np.frombuffer(data[start : start + size], dtype="<f4")
        yield name.removesuffix(_SUFFIX), values.reshape(shape)


def _rows(table: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Keys and values of a LevelDB table."""
    footer = _numbers(table[-_FOOTER:], 4)
    for _, handle in _block(table, footer[2], footer[3]):
        yield from _block(table, *_numbers(handle, 2))


def _block(table: bytes, start: int, size: int) -> Iterator[tuple[bytes, bytes]]:
    """Rows of a block: each key repeats the beginning of the one before it."""
    if table[start + size] != 0:
        raise ValueError("compressed")
    block = table[start : start + size]
    restarts = int.from_bytes(block[-4:], "little")
    at, key = 0, b""
    while at < size - 4 - 4 * restarts:
        (shared, fresh, length), at = _numbers_at(block, at, 3)
        key = key[:shared] + block[at : at + fresh]
        yield key, block[at + fresh : at + fresh + length]
        at += fresh + length


def _fields(message: bytes) -> Mapping[int, list[Any]]:
    """Values of a protocol buffer's fields by their numbers."""
    found: dict[int, list[Any]] = {}
    at = 0
    while at < len(message):
        (tag,), at = _numbers_at(message, at, 1)
        value: int | bytes
        if tag & 7 == 0:
            (value,), at = _numbers_at(message, at, 1)
        else:
            size = 4
            if tag & 7 == 2:
                (size,), at = _numbers_at(message, at, 1)
            value, at = message[at : at + size], at + size
        found.setdefault(tag >> 3, []).append(value)
    return found


def _numbers(source: bytes, count: int) -> list[int]:
    return _numbers_at(source, 0, count)[0]


def _numbers_at(source: bytes, at: int, count: int) -> tuple[list[int], int]:
    """Some numbers of seven bits a byte, and where the next byte is."""
    found = []
    for _ in range(count):
        number = shift = 0
        while source[at] & 128:
            number |= (source[at] & 127) << shift
            at, shift = at + 1, shift + 7
        found.append(number | source[at] << shift)
        at += 1
    return found, at
