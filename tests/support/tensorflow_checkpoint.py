"""Checkpoints as TensorFlow writes them: an index of variables (a LevelDB table) and their data."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

_SUFFIX = "/.ATTRIBUTES/VARIABLE_VALUE"


def checkpoint(variables: Mapping[str, np.ndarray]) -> tuple[bytes, bytes]:
    """Index and data of variables in single precision, one optimiser's slot among them."""
    slotted = {**variables, "a/.OPTIMIZER_SLOT/adam/m": np.zeros(3, dtype=np.float32)}
    data, rows = b"", [(b"", b"\x08\x01")]  # the header: one shard
    for name in sorted(slotted):
        values = np.asarray(slotted[name], dtype="<f4")
        sizes = b"".join(_message(2, b"\x08" + _number(size)) for size in values.shape)
        place = b"\x20" + _number(len(data)) + b"\x28" + _number(values.nbytes)
        crc = b"\x35" + bytes(4)
        rows.append((f"{name}{_SUFFIX}".encode(), b"\x08\x01" + _message(2, sizes) + place + crc))
        data += values.tobytes()
    block = _block(rows)
    meta = _block([])
    handles = _number(len(block)) + _number(len(meta) - 5)
    index = _block([(rows[-1][0], _number(0) + _number(len(block) - 5))])
    where = _number(len(block) + len(meta)) + _number(len(index) - 5)
    footer = (handles + where).ljust(40, b"\0") + bytes.fromhex("57fb808b247547db")
    return block + meta + index + footer, data


def _block(rows: list[tuple[bytes, bytes]]) -> bytes:
    """Rows whose keys share their beginnings; then restarts, the kind (plain) and a check sum."""
    body, last = b"", b""
    for key, value in rows:
        shared = 0
        while shared < min(len(key), len(last)) and key[shared] == last[shared]:
            shared += 1
        fresh = key[shared:]
        body += _number(shared) + _number(len(fresh)) + _number(len(value)) + fresh + value
        last = key
    return body + bytes(4) + (1).to_bytes(4, "little") + bytes(5)


def _message(field: int, content: bytes) -> bytes:
    return _number(field << 3 | 2) + _number(len(content)) + content


def _number(value: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    groups = b""
    while value > 127:
        groups += bytes([value & 127 | 128])
        value >>= 7
    return groups + bytes([value])
