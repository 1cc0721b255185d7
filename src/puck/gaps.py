"""Compression by LZMA of the bytes between the packets of a recording, which are called gaps.

Gaps of equal length, mostly headers of packets, are stored together as differences between
successive gaps. Long gaps, such as images between clouds, are stored so only if a sample shows that
this takes fewer bytes.
"""

from __future__ import annotations

import lzma
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError
from puck.records import DAMAGED, check

Bytes = NDArray[np.uint8]

MOST_RAW_BYTES = 1 << 26
"""Maximum number of bytes of a batch before compression."""
_GROUPS = 32
"""Maximum number of frequent lengths; only gaps of these lengths are coded as differences."""
_HEADERS: dict[str, int] = {"lc": 0, "pb": 0, "nice_len": 64}
"""LZMA options for differences of headers, in which adjacent bytes are nearly independent. Output
is no larger than with the preset, and takes a fifth of the time."""
_OPTIONS: tuple[dict[str, int], ...] = ({}, {"lc": 4, "pb": 0}, _HEADERS)
"""LZMA options among which a sample of other gaps decides: the preset, options for messages, whose
numbers are not aligned, and those for headers."""
_SAMPLE, _SAMPLES = 1 << 16, 4
"""Number of bytes of which a sample is compressed to choose among options, and number of parts in
which it is taken from all of the bytes. Fewer bytes than `_SAMPLES` samples are compressed as a
whole with each of the options."""
_LONG, _ROWS = 1 << 10, 4
"""Number of bytes from which a gap is long, and number of gaps of which a sample is taken."""
_CHUNK = 1 << 16
"""Maximum number of bytes of an LZMA2 chunk that is stored uncompressed."""


def encode_gaps(gaps: list[bytes], are_headers: bool = False) -> bytes:
    """Return gaps compressed by LZMA; `are_headers` selects options for headers of packets."""
    raw = _joined(gaps)
    if are_headers:
        return compress_bytes(raw, are_headers)
    if len(raw) <= _SAMPLES * _SAMPLE:
        return min((_compressed(raw, options) for options in _OPTIONS), key=len)
    part = _SAMPLE // _SAMPLES
    starts = [k * (len(raw) - part) // (_SAMPLES - 1) for k in range(_SAMPLES)]
    sample = b"".join(raw[at : at + part] for at in starts)
    return _compressed(raw, min(_OPTIONS, key=lambda options: len(_compressed(sample, options))))


def store_gaps(gaps: list[bytes]) -> bytes:
    """Return uncompressed gaps in the format of `encode_gaps`, where LZMA would enlarge them."""
    raw = _joined(gaps)
    chunks = (raw[first : first + _CHUNK] for first in range(0, len(raw), _CHUNK))
    parts = (b"\1" + (len(chunk) - 1).to_bytes(2, "big") + chunk for chunk in chunks)
    return base_128(len(raw)) + b"".join(parts) + b"\0"


def decode_gaps(reader: Reader, count: int, admit: Callable[[int], None]) -> list[bytes]:
    """Read and return `count` gaps that `encode_gaps` or `store_gaps` encoded.

    Before they are decompressed, `admit` is called with the total size in bytes. It raises an error
    if the size is too large.
    """
    body = Reader(decompress_bytes(reader, admit))
    size = len(body.body)
    runs = [(body.number(), body.number()) for _ in range(min(body.number(), size))]
    check(sum(repeats for _, repeats in runs) == count)
    lengths = np.repeat([length for length, _ in runs], [repeats for _, repeats in runs])
    unchanged = {length for length, repeats in runs if not repeats}
    check(sum(length * repeats for length, repeats in runs) <= size)
    groups: dict[int, Iterator[bytes]] = {}
    for length in _frequent(lengths):
        if length in unchanged:
            continue
        rows = int(np.count_nonzero(lengths == length))
        planes = np.frombuffer(body.take(length * rows), np.uint8)
        groups[length] = iter([row.tobytes() for row in _rows(planes, rows, length)])
    gaps = [
        next(groups[length]) if length in groups else body.take(length)
        for length in lengths.tolist()
    ]
    check(not body.rest())
    return gaps


def compress_bytes(raw: bytes, are_headers: bool = False) -> bytes:
    """Return the length of `raw` as a base-128 number, followed by the LZMA2 stream."""
    return _compressed(raw, _HEADERS if are_headers else {})


def _compressed(raw: bytes, options: dict[str, int]) -> bytes:
    filters = [{**_filter(len(raw)), **options}]
    return base_128(len(raw)) + lzma.compress(raw, lzma.FORMAT_RAW, filters=filters)


def decompress_bytes(reader: Reader, admit: Callable[[int], None]) -> bytes:
    """Read and return bytes that `compress_bytes` compressed.

    Before, `admit` is called with their number; it raises an error if there are too many.
    """
    size = reader.number()
    check(size <= MOST_RAW_BYTES)
    admit(size)
    decompressor = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=[_filter(size)])
    try:
        raw = decompressor.decompress(reader.rest(), size + 1)
    except lzma.LZMAError as error:
        raise InputError(DAMAGED) from error
    check(len(raw) == size)
    return raw


def _filter(size: int) -> dict[str, int]:
    # Clearing the memory of a larger dictionary than needed would take time.
    dictionary = min(1 << max(size.bit_length(), 12), 1 << 24)
    return {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "dict_size": dictionary}


def _joined(gaps: list[bytes]) -> bytes:
    lengths = np.array([len(gap) for gap in gaps])
    edges = np.flatnonzero(np.diff(lengths, prepend=-1))
    counts = np.diff(edges, append=len(lengths))
    runs = [
        base_128(int(lengths[edge])) + base_128(int(count))
        for edge, count in zip(edges, counts, strict=True)
    ]
    frequent: dict[int, list[bytes]] = {length: [] for length in _frequent(lengths)}
    for gap in gaps:
        if len(gap) in frequent:
            frequent[len(gap)].append(gap)
    planes = []
    for length, group in [*frequent.items()]:
        rows = np.frombuffer(b"".join(group), np.uint8).reshape(-1, length)
        if length < _LONG or _are_alike(rows):
            planes.append(_planes(rows))
        else:
            del frequent[length]
            runs.append(base_128(length) + base_128(0))  # states that these gaps are unchanged
    others = [gap for gap in gaps if len(gap) not in frequent]
    return b"".join([base_128(len(runs)), *runs, *planes, *others])


def _are_alike(rows: Bytes) -> bool:
    """Return whether successive rows (n, length) take fewer bytes as differences, by a sample."""
    width = min(_SAMPLE // _ROWS, rows.shape[1])
    row, column = max(len(rows) - _ROWS, 0) // 2, (rows.shape[1] - width) // 8 * 4
    some = rows[row : row + _ROWS, column : column + width]
    plain, planes = some.tobytes(), _planes(some)
    return len(_compressed(planes, _HEADERS)) < len(_compressed(plain, {}))


def _frequent(lengths: NDArray[np.int64]) -> list[int]:
    values, counts = np.unique(lengths, return_counts=True)
    order = np.lexsort((values, -counts))
    return [int(values[k]) for k in order if values[k] > 0 and counts[k] > 1][:_GROUPS]


def _planes(rows: Bytes) -> bytes:
    """Encode differences between successive rows (n, length), the first bytes of all rows first."""
    words, tail = _words(rows)
    words = np.diff(words, axis=0, prepend=np.zeros_like(words[:1]))
    tail = np.diff(tail, axis=0, prepend=np.zeros_like(tail[:1]))
    planes = np.concatenate([words.view(np.uint8).reshape(len(rows), -1), tail], axis=1)
    return planes.T.tobytes()


def _rows(planes: Bytes, count: int, length: int) -> Bytes:
    words, tail = _words(np.ascontiguousarray(planes.reshape(length, count).T))
    words = np.cumsum(words, axis=0, dtype="<u4")
    tail = np.cumsum(tail, axis=0, dtype=np.uint8)
    head = words.astype("<u4").view(np.uint8).reshape(count, -1)
    rows: Bytes = np.concatenate([head, tail], axis=1)
    return rows


def _words(rows: Bytes) -> tuple[NDArray[np.uint32], Bytes]:
    end = rows.shape[1] // 4 * 4
    words = np.ascontiguousarray(rows[:, :end]).view("<u4").reshape(len(rows), -1)
    return words, np.ascontiguousarray(rows[:, end:])
