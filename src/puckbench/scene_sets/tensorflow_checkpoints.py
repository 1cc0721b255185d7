"""Reader of TensorFlow checkpoints with an index and one data file, without TensorFlow.

The index is an uncompressed LevelDB table of names and `BundleEntryProto` messages (type, shape and
position in the data file).

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

from pointkit.errors import InputError

_SUFFIX = "/.ATTRIBUTES/VARIABLE_VALUE"
_SLOT = "/.OPTIMIZER_SLOT/"
_FLOAT = 1
_FOOTER_BYTES = 48
_TYPE, _SHAPE, _OFFSET, _SIZE = 1, 2, 4, 5
"""Fields of a `BundleEntryProto`."""


def read_variables(index: bytes, data: bytes) -> dict[str, NDArray[np.float32]]:
    """Read the float32 variables of a checkpoint, without those of the optimiser.

    Parameters
    ----------
    index, data
        Contents of the checkpoint's index file and data file.

    Returns
    -------
    dict
        Arrays by name of the variable.

    Raises
    ------
    InputError
        The files are not a TensorFlow checkpoint.
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
    footer = _varints(table[-_FOOTER_BYTES:], 4)
    for _, handle in _block(table, footer[2], footer[3]):
        yield from _block(table, *_varints(handle, 2))


def _block(table: bytes, start: int, size: int) -> Iterator[tuple[bytes, bytes]]:
    """Yield keys and values of a block; a stored key omits the prefix shared with the last key."""
    if table[start + size] != 0:
        raise ValueError("compressed")
    block = table[start : start + size]
    restarts = int.from_bytes(block[-4:], "little")
    at, key = 0, b""
    while at < size - 4 - 4 * restarts:
        (shared, unshared, length), at = _varints_at(block, at, 3)
        key = key[:shared] + block[at : at + unshared]
        yield key, block[at + unshared : at + unshared + length]
        at += unshared + length


def _fields(message: bytes) -> Mapping[int, list[Any]]:
    fields: dict[int, list[Any]] = {}
    at = 0
    while at < len(message):
        (tag,), at = _varints_at(message, at, 1)
        value: int | bytes
        if tag & 7 == 0:
            (value,), at = _varints_at(message, at, 1)
        else:
            size = 4
            if tag & 7 == 2:
                (size,), at = _varints_at(message, at, 1)
            value, at = message[at : at + size], at + size
        fields.setdefault(tag >> 3, []).append(value)
    return fields


def _varints(source: bytes, count: int) -> list[int]:
    return _varints_at(source, 0, count)[0]


def _varints_at(source: bytes, at: int, count: int) -> tuple[list[int], int]:
    numbers = []
    for _ in range(count):
        number = shift = 0
        while source[at] & 128:
            number |= (source[at] & 127) << shift
            at, shift = at + 1, shift + 7
        numbers.append(number | source[at] << shift)
        at += 1
    return numbers, at
