"""Order of the content of SQLite files in which long rows, such as messages, are contiguous.

SQLite stores the beginning of a long row in a leaf of the table's tree, and the rest in a chain of
overflow pages. In this order, the beginning follows directly before the rest.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Iterator
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader
from pointkit.errors import InputError
from puck.gaps import MOST_RAW_BYTES, Bytes, compress_bytes, decompress_bytes
from puck.records import check
from puck.sqlite_pages import LINK_BYTES

_LEAF = 13
"""First byte of a leaf of a table's tree."""
_FILE_HEADER, _LEAF_HEADER = 100, 8
_RESERVED_AT = 20
_LONGEST_NUMBER = 9
_INTEGER_BYTES = 4
_FEW_PARTS, _PARTS_PER_BYTE = 1 << 18, 8
"""Limit of the parts of the content: a constant, and more for each byte of the encoded rows."""
_VISITS = 4
"""Limit of the pages that are visited in search of usable rows, for each page of the file."""
Ints = NDArray[np.int64]


class Payload(NamedTuple):
    """Long row of a table: the page (from 0) of its beginning, the position of the beginning in the
    page, the number of bytes of the row, and its first overflow page (from 0).
    """

    leaf: int
    place: int
    size: int
    first: int


def encode_payloads(payloads: list[Payload]) -> bytes:
    """Return rows as bytes, which `decode_payloads` reads."""
    columns = np.ascontiguousarray(np.array(payloads, np.int64).T)
    steps = np.diff(columns, axis=1, prepend=0).astype("<i4")
    planes = steps.view(np.uint8).reshape(len(columns), -1, _INTEGER_BYTES).swapaxes(1, 2)
    return compress_bytes(planes.tobytes())


def most_parts(body: bytes) -> int:
    """Return how many parts of the content the rows that `encode_payloads` encoded may form."""
    most = _FEW_PARTS + _PARTS_PER_BYTE * len(body)
    return min(most, MOST_RAW_BYTES // (len(Payload._fields) * _INTEGER_BYTES))


def decode_payloads(body: bytes, most: int) -> Ints:
    """Return the rows (n, 4) that `encode_payloads` encoded; there may be `most` of them."""
    row = len(Payload._fields) * _INTEGER_BYTES
    raw = decompress_bytes(Reader(body), lambda size: check(size <= row * most))
    check(len(raw) % row == 0)
    planes = np.frombuffer(raw, np.uint8).reshape(len(Payload._fields), _INTEGER_BYTES, -1)
    steps = np.ascontiguousarray(planes.swapaxes(1, 2)).view("<i4")[..., 0]
    return np.cumsum(steps, axis=1, dtype=np.int64).T


def find_payloads(pages: Bytes, first: int) -> list[Payload]:
    """Return the long rows that begin in `pages` (n, bytes), whose first has the number `first`.

    Bytes that only look like a leaf can give wrong rows.
    """
    found: list[Payload] = []
    size = pages.shape[1]
    for number, page in enumerate(pages, first):
        head = 0 if number else _FILE_HEADER
        if page[head] == _LEAF:
            found += _rows_of(number, page, head, size)
    return found


def _rows_of(number: int, page: Bytes, head: int, size: int) -> list[Payload]:
    count = int.from_bytes(page[head + 3 : head + 5].tobytes(), "big")
    start = head + _LEAF_HEADER
    if start + 2 * count > size:
        return []
    cells = page[start : start + 2 * count].view(">u2").astype(np.int64)
    cells = cells[(cells >= start) & (cells < size - 2 * _LONGEST_NUMBER - LINK_BYTES)]
    high, low = page[cells].astype(np.int64), page[cells + 1].astype(np.int64)
    is_long = (high >= 128) & ((low >= 128) | ((high & 127) * 128 + low > _longest_local(size)))
    if np.count_nonzero(is_long) * _least_local(size) > size:  # cells that overlap
        return []
    rows = []
    for cell in cells[is_long].tolist():
        numbers = page[cell : cell + 2 * _LONGEST_NUMBER].tobytes()
        length, at = _varint(numbers, 0)
        place = cell + _varint(numbers, at)[1]
        end = place + _local_bytes(length, size)
        if length < 1 << 31 and end + LINK_BYTES <= size:
            link = int.from_bytes(page[end : end + LINK_BYTES].tobytes(), "big")
            rows.append(Payload(number, place, length, link - 1))
    return rows


def _varint(data: bytes, at: int) -> tuple[int, int]:
    number = 0
    for _ in range(_LONGEST_NUMBER - 1):
        number = number << 7 | data[at] & 127
        at += 1
        if data[at - 1] < 128:
            return number, at
    return number << 8 | data[at], at + 1


def _longest_local(page: int) -> int:
    return page - 35


def _least_local(page: int) -> int:
    return (page - 12) * 32 // 255 - 23


def _local_bytes(length: int, page: int) -> int:
    least = _least_local(page)
    local = least + (length - least) % (page - LINK_BYTES)
    return local if local <= _longest_local(page) else least


class _Run(NamedTuple):
    first: int
    pages: int


class PageOrder:
    """Order of the content of pages, i.e. of all bytes but their links.

    Parameters
    ----------
    page
        Number of bytes of a page.
    links
        Links (n, 4) of all pages.
    """

    def __init__(self, page: int, links: Bytes) -> None:
        self.page, self.content = page, page - LINK_BYTES
        self._next = np.ascontiguousarray(links).view(">u4")[:, 0].astype(np.int64) - 1
        pages = np.arange(len(links))
        self._ends = np.flatnonzero(self._next != pages + 1)  # of runs of successive pages

    def usable(self, payloads: list[Payload]) -> list[Payload]:
        """Return the rows whose overflow pages are in the file, and are no other row's, sorted."""
        is_free, usable = np.ones(len(self._next), bool), []
        visits = _VISITS * len(self._next)
        for payload in sorted(payloads, key=lambda each: each.first):
            taken: list[slice] = []
            try:
                for run in self._chain(payload):
                    pages = slice(run.first, run.first + run.pages)
                    visits -= run.pages
                    check(visits >= 0 and bool(is_free[pages].all()))
                    is_free[pages] = False
                    taken.append(pages)
            except InputError:
                for pages in taken:
                    is_free[pages] = True
            else:
                usable.append(payload)
        return usable

    def parts(self, payloads: list[Payload] | Ints, most: int) -> Ints:
        """Return the parts (n, 2) of the content: position of the first byte, and length in bytes.

        Raises InputError unless the parts cover all bytes once, and the rows have at most `most`.
        """
        total = len(self._next) * self.content
        pages = 0
        keys, parts = array("q"), array("q")
        for row in payloads:
            payload = Payload(*map(int, row))
            check(payload.size > 0 and LINK_BYTES <= payload.place < self.page)
            check(0 <= payload.leaf < len(self._next) and 0 <= payload.first < len(self._next))
            pages += self._overflow_pages(payload)
            check(pages <= len(self._next))
            begin = payload.leaf * self.content + payload.place - LINK_BYTES
            parts.extend((begin, _local_bytes(payload.size, self.page)))
            keys.append(payload.first * self.content)
            for run in self._chain(payload):
                parts.extend((run.first * self.content, run.pages * self.content))
                keys.append(payload.first * self.content)
                check(len(keys) <= most)
        moved = np.array(parts, np.int64).reshape(-1, 2)
        sorted_parts = moved[np.argsort(moved[:, 0], kind="stable")]
        starts = np.concatenate([[0], sorted_parts.sum(axis=1)])
        ends = np.concatenate([sorted_parts[:, 0], [total]])
        check(bool((ends >= starts).all()))
        rest = np.stack([starts, ends - starts], axis=1)[ends > starts]
        together = np.concatenate([moved, rest])
        order = np.argsort(np.concatenate([np.array(keys, np.int64), rest[:, 0]]), kind="stable")
        return together[order]

    def _overflow_pages(self, payload: Payload) -> int:
        return -(-(payload.size - _local_bytes(payload.size, self.page)) // self.content)

    def _chain(self, payload: Payload) -> Iterator[_Run]:
        """Yield the overflow pages of a row as runs of successive pages."""
        page, count = payload.first, self._overflow_pages(payload)
        check(0 < count <= len(self._next))
        while count:
            check(0 <= page < len(self._next))
            end = np.searchsorted(self._ends, page)
            last = int(self._ends[end]) if end < len(self._ends) else len(self._next) - 1
            run = _Run(page, min(last - page + 1, count))
            yield run
            count -= run.pages
            page = int(self._next[last])


class PageWriter:
    """Places in a file of the bytes that come in the order of a recording's content.

    Parameters
    ----------
    page
        Number of bytes of an SQLite file's page, or 0 for a file without pages.
    links
        Links (n, 4) of all pages.
    """

    def __init__(self, page: int = 0, links: Bytes | None = None) -> None:
        self.page, self._content = page, page - LINK_BYTES
        self._links = np.zeros((0, LINK_BYTES), np.uint8) if links is None else links
        self._parts = iter(np.array([(0, self.content_size)]))
        self._at, self._end = 0, 0

    @property
    def content_size(self) -> int:
        """Number of bytes of the content of all pages."""
        return len(self._links) * self._content

    def is_whole(self, size: int) -> bool:
        """Return whether a file of so many bytes has all pages, or no pages at all."""
        return not self.page or size == len(self._links) * self.page

    def set_payloads(self, body: bytes) -> None:
        """Read the body of a PAYLOADS record, which changes the order of the content."""
        check(self.page > 0)
        most = most_parts(body)
        payloads = decode_payloads(body, min(most, len(self._links)))
        self._parts = iter(PageOrder(self.page, self._links).parts(payloads, most))

    def pieces(self, data: bytes | memoryview) -> Iterator[tuple[int, bytes | memoryview]]:
        """Yield places in the file, and the bytes there, for the next bytes of the content.

        The links of a page come before its content.
        """
        if not self.page:
            yield self._at, data
            self._at += len(data)
            return
        rest = memoryview(data)
        while rest:
            if self._at == self._end:
                first, size = map(int, next(self._parts, (0, 0)))
                check(size > 0)
                self._at, self._end = first, first + size
            number, within = divmod(self._at, self._content)
            if within == 0:
                yield number * self.page, self._links[number].tobytes()
            part = rest[: min(self._content - within, self._end - self._at)]
            yield number * self.page + LINK_BYTES + within, part
            self._at, rest = self._at + len(part), rest[len(part) :]


def state_of(file: IO[bytes]) -> tuple[int, int]:
    """Return the size of a file in bytes and the time of its last change."""
    status = os.fstat(file.fileno())
    return status.st_size, status.st_mtime_ns


class PageReader:
    """Stream of the content of an SQLite file, in the order of its parts.

    Parameters
    ----------
    stream
        The file.
    page
        Number of bytes of a page.
    parts
        Position of the first byte of each part in the content, and length in bytes (n, 2).
    state
        What `state_of` returned of the file before it was searched for the parts.
    """

    def __init__(self, stream: IO[bytes], page: int, parts: Ints, state: tuple[int, int]) -> None:
        self._stream, self._page, self._parts, self._state = stream, page, iter(parts), state
        self._at, self._end = 0, 0

    def read(self, size: int) -> bytes:
        """Return at most `size` bytes, and none only at the end."""
        if self._at == self._end:
            first, length = map(int, next(self._parts, (0, 0)))
            self._at, self._end = first, first + length
            if not length and state_of(self._stream) != self._state:
                raise InputError(f"{self._stream.name}: changes while it is read")
        content = self._page - LINK_BYTES
        end = min(self._at + size, self._end)
        first, last = self._at // content, -(-end // content)
        self._stream.seek(first * self._page)
        raw = self._stream.read((last - first) * self._page)
        pages = np.frombuffer(raw, np.uint8)
        if len(raw) < (last - first) * self._page:
            raise InputError(f"{self._stream.name}: changes while it is read")
        part = pages.reshape(-1, self._page)[:, LINK_BYTES:].ravel()
        part = part[self._at - first * content : end - first * content]
        self._at = end
        return part.tobytes()
