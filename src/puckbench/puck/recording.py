"""Recordings as streams, bit for bit: turns of the known packets, and all other bytes beside them.

Packets are found by their bytes, whatever the file's format: packet captures, and bags that are
not compressed themselves. SQLite cuts what is long into pages, each of which begins with the number
of the next; these numbers are taken out first, so that the packets are whole.
"""

from __future__ import annotations

import lzma
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.byte_io import Reader, base_128
from puckbench.core.errors import InputError, naming
from puckbench.core.files import unreadable, written_whole
from puckbench.lidar.recordings.packet_turns import (
    PacketKind,
    Payloads,
    find_packets,
    packet_kind,
    packets_of,
    split_turns,
    turn_of,
)
from puckbench.lidar.recordings.packets import PACKET_BYTES
from puckbench.lidar.returns_header import decode_layout, encode_layout
from puckbench.puck.options import CodingOptions
from puckbench.puck.records import Record, RecordKind, read_records, start
from puckbench.puck.stream import count_ranges, most_ranges
from puckbench.puck.turns import TurnDecoder, TurnEncoder

_WINDOW = 1 << 24
"""Bytes that are searched for packets at a time; their turns are one batch."""
_MOST_RAW = 1 << 26
"""Bytes between the packets of a batch, at most."""
_MANY_BYTES, _BYTES_PER_BYTE = 3 << 24, 40
"""Bytes of a recording that any stream may hold, and for each byte of it beside them."""
_FRAME = 16
"""Bytes that say how long a window without packets is, at most."""
_GROUPS = 32
"""Lengths of gaps that are coded together, at most."""
_HEADERS: dict[str, int] = {"lc": 0, "pb": 0, "nice_len": 64}
"""LZMA of headers' columns, where a byte's neighbours and place tell little: no larger than by the
preset alone, in a fifth of the time."""
_SQLITE = b"SQLite format 3\x00"
_LINK = 4
_SMALLEST_PAGE, _LARGEST_PAGE = 512, 1 << 16
_CHUNK = 1 << 16
"""Bytes of a chunk that LZMA2 stores, at most."""
_DAMAGED = "the stream is damaged"

Bytes = NDArray[np.uint8]
Tell = Callable[[int, int], None]


@dataclass(kw_only=True)
class _Contents:
    """Counts of what is in a recording or in a part of it."""

    packets: int = 0
    turns: int = 0
    returns: int = 0
    ranges: int = 0

    def add(self, part: _Contents) -> None:
        """Count a further part."""
        self.packets += part.packets
        self.turns += part.turns
        self.returns += part.returns
        self.ranges += part.ranges


@dataclass(kw_only=True)
class Account(_Contents):
    """What was in a recording, and what became of it."""

    bytes: int = 0
    compressed: int = 0
    parts: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class _Limits:
    """What a stream of `size` bytes may hold, at most; a trusted one anything."""

    size: int
    trusted: bool = False

    @property
    def bytes(self) -> int:
        """Bytes of a recording, without the links of its pages."""
        return _MANY_BYTES + _BYTES_PER_BYTE * self.size

    @property
    def ranges(self) -> int:
        """Ranges, and what turns cost beside them."""
        return most_ranges(self.size)

    def check(self, number: int, most: int, what: str) -> None:
        """Refuse more than there may be, before it is decoded."""
        if number > most and not self.trusted:
            raise InputError(
                f"{number} {what} in {self.size} bytes: more than they may hold; if you trust the "
                "file, restore it with puckbench decompress --trusted"
            )


@dataclass(kw_only=True)
class _Batch(_Contents):
    """The records of a window, and counts of what is in them."""

    records: list[Record] = field(default_factory=list)


def compress(
    recording: Path, out: Path, options: CodingOptions | None = None, tell: Tell | None = None
) -> Account:
    """Write a recording as a stream from which `decompress` makes the same file.

    Parameters
    ----------
    recording
        Any file; what is no data packet of a known sensor is stored by LZMA.
    out
        The stream.
    options
        Effort and key turns; a step other than 1 is refused.
    tell
        Called with the numbers of bytes done and in all.

    Raises
    ------
    InputError
        The recording cannot be read or `out` not be written, or both are one file.
    """
    chosen = options or CodingOptions()
    if chosen.step != 1 or not chosen.times or not chosen.reflectivities:
        raise InputError("a recording is compressed without loss and with all that is in it")
    _check_apart(recording, out)
    data = _opened(recording)
    account = Account(bytes=len(data))
    with written_whole(out) as temporary, temporary.open("wb") as stream:
        account.compressed = stream.write(start())
        for record in _records(data, chosen, account, tell or _silent):
            written = stream.write(record.packed())
            name = record.kind.name.lower()
            account.parts[name] = account.parts.get(name, 0) + written
            account.compressed += written
    return account


def _silent(done: int, size: int) -> None:
    """Tell nothing."""


def decompress(
    path: Path, out: Path, tell: Tell | None = None, *, trusted: bool = False
) -> Account:
    """Write the recording of a stream.

    Parameters
    ----------
    path, out
        The stream, and the recording to write.
    tell
        Called with the numbers of bytes done and in all.
    trusted
        Restore also what is far larger than `compress` lets a stream of this size become.

    Raises
    ------
    InputError
        The stream is damaged or another's, holds no whole recording, `out` cannot be written, or
        both are one file.
    """
    _check_apart(path, out)
    try:
        size = path.stat().st_size
        source = path.open("rb")
    except OSError as error:
        raise unreadable(path, error) from error
    with source, written_whole(out) as temporary, temporary.open("wb") as stream, naming(path):
        return _restore(source, stream, _Limits(size, trusted), tell or _silent)


def _check_apart(source: Path, out: Path) -> None:
    if source.exists() and out.exists() and source.samefile(out):
        raise InputError(f"{out}: is the file that is read; name another one to write")


def _opened(path: Path) -> Bytes:
    """The bytes of a file, read when they are looked at."""
    try:
        if path.stat().st_size == 0:
            return np.zeros(0, np.uint8)
        data: Bytes = np.asarray(np.memmap(path, np.uint8, "r"))
    except (OSError, ValueError) as error:
        if path.is_dir():
            raise InputError(f"{path}: a folder; compress the files in it") from error
        raise unreadable(path, error if isinstance(error, OSError) else OSError()) from error
    return data


def _records(data: Bytes, options: CodingOptions, account: Account, tell: Tell) -> Iterator[Record]:
    """The records of a recording's bytes; whoever writes one adds its bytes to `account`."""
    page = _page_size(data)
    check = _check_of(data)
    size = len(data)
    if page:
        pages = data.reshape(-1, page)
        yield Record(
            RecordKind.PAGES, base_128(page) + _packed(_linked(pages[:, :_LINK]), _HEADERS)
        )
        size = len(pages) * (page - _LINK)
    encoder = _PacketEncoder(options)
    done = 0
    while done < size:
        window = _window(data, page, done, min(done + _WINDOW, size))
        places = find_packets(window)
        is_last = done + len(window) == size
        # A packet that the window cuts is whole in the next one.
        end = len(window) if is_last else max(len(window) - PACKET_BYTES + 1, _end_of(places))
        batches = encoder.batches(window[:end], places, partial(_tell_within, tell, done, size))
        batch = next(each for each in batches if _fits(each, account, done + end))
        account.add(batch)
        yield from batch.records
        done += end
        tell(done, size)
    yield Record(RecordKind.END, account.bytes.to_bytes(8, "little") + check)


def _tell_within(tell: Tell, done: int, size: int, reached: int) -> None:
    if reached:
        tell(done + reached, size)


def _fits(batch: _Batch, account: Account, done: int) -> bool:
    """Whether a decoder takes `done` bytes of a recording, the last of them from a batch."""
    limits = _Limits(account.compressed + sum(len(record.body) for record in batch.records))
    done += _FRAME
    return account.ranges + batch.ranges <= limits.ranges and done <= limits.bytes


def _window(data: Bytes, page: int, first: int, end: int) -> Bytes:
    """Bytes from `first` to before `end` of a file, the links of its pages left out."""
    if not page:
        return data[first:end]
    whole = page - _LINK
    start = first // whole
    part = data.reshape(-1, page)[start : -(-end // whole), _LINK:].ravel()
    return part[first - start * whole : end - start * whole]


def _end_of(places: NDArray[np.int64]) -> int:
    return int(places[-1]) + PACKET_BYTES if len(places) else 0


def _check_of(data: Bytes) -> bytes:
    check = 0
    for first in range(0, len(data), _WINDOW):
        check = zlib.crc32(data[first : first + _WINDOW].tobytes(), check)
    return check.to_bytes(4, "little")


def _page_size(data: Bytes) -> int:
    """Bytes of a page of an SQLite file; 0 for another file, or one that is cut off."""
    if data[: len(_SQLITE)].tobytes() != _SQLITE or len(data) < 512:
        return 0
    size = int.from_bytes(data[16:18].tobytes(), "big")
    size = _LARGEST_PAGE if size == 1 else size
    if size < _SMALLEST_PAGE or len(data) % size or len(data) // size * _LINK > _MOST_RAW:
        return 0
    return size


def _linked(links: Bytes) -> bytes:
    """Big-endian numbers (n, 4) as differences, the highest bytes of all first."""
    numbers = np.ascontiguousarray(links).view(">u4")[:, 0].astype(np.uint32)
    return np.diff(numbers, prepend=np.uint32(0)).astype(">u4").view(np.uint8).reshape(
        -1, _LINK
    ).T.tobytes()  # fmt: skip


def _unlinked(body: bytes) -> Bytes:
    planes = np.frombuffer(body, np.uint8).reshape(_LINK, -1).T
    steps = np.ascontiguousarray(planes).view(">u4")[:, 0].astype(np.uint32)
    numbers = np.cumsum(steps, dtype=np.uint32).astype(">u4")
    return numbers.view(np.uint8).reshape(-1, _LINK)


class _PacketEncoder:
    """Encodes batches of packets and what lies between them."""

    def __init__(self, options: CodingOptions) -> None:
        self._options = options
        self._kind: PacketKind | None = None
        self._turns: TurnEncoder | None = None

    def batches(
        self, data: Bytes, places: NDArray[np.int64], tell: Callable[[int], None]
    ) -> Iterator[_Batch]:
        """Some bytes with packets at some places in three ways, the smallest first.

        Packets as turns, all bytes by LZMA, and all bytes as they are, which always fits.
        """
        yield self._batch(data, places, tell)
        self._turns = None
        raw = _gathered([data.tobytes()])
        for gaps in (_packed(raw), _stored(raw)):
            yield _Batch(records=[Record(RecordKind.GAPS, base_128(0) + gaps)])

    def _batch(self, data: Bytes, places: NDArray[np.int64], tell: Callable[[int], None]) -> _Batch:
        batch = _Batch()
        if len(places):
            rows = places[:, None] + np.arange(PACKET_BYTES)
            for kind, payloads in split_turns(data[rows]):
                self._add_turn(kind, payloads, batch)
                tell(int(places[batch.packets - 1]))
        starts = np.concatenate([[0], places + PACKET_BYTES])
        ends = np.concatenate([places, [len(data)]])
        gaps = [
            data[first:end].tobytes()
            for first, end in zip(starts.tolist(), ends.tolist(), strict=True)
        ]
        # What outweighs the packets is no headers.
        options = _HEADERS if len(data) < 2 * PACKET_BYTES * len(places) else {}
        packed_gaps = _packed(_gathered(gaps), options)
        batch.records.append(Record(RecordKind.GAPS, base_128(len(places)) + packed_gaps))
        return batch

    def _add_turn(self, kind: PacketKind, payloads: Payloads, batch: _Batch) -> None:
        if self._turns is None or kind != self._kind:
            self._kind, self._turns = kind, TurnEncoder(kind.layout, self._options)
            layout = encode_layout(kind.layout) + bytes([kind.product, kind.mode])
            batch.records.append(Record(RecordKind.LAYOUT, layout))
        turn = turn_of(kind, payloads)
        body = self._turns.encode(turn)
        batch.records.append(Record(RecordKind.TURN, body))
        batch.turns += 1
        batch.packets += len(payloads)
        batch.returns += turn.returns
        batch.ranges += count_ranges(kind.layout, body)


def _gathered(gaps: list[bytes]) -> bytes:
    """Gaps by their lengths: the lengths as runs, then the gaps of each length together."""
    lengths = np.array([len(gap) for gap in gaps])
    edges = np.flatnonzero(np.diff(lengths, prepend=-1))
    counts = np.diff(edges, append=len(lengths))
    runs = [
        base_128(int(lengths[edge])) + base_128(int(count))
        for edge, count in zip(edges, counts, strict=True)
    ]
    parts = [base_128(len(runs)), *runs]
    common = _common(lengths)
    for length in common:
        alike = [gap for gap in gaps if len(gap) == length]
        parts.append(_columns(np.frombuffer(b"".join(alike), np.uint8).reshape(-1, length)))
    parts += [gap for gap in gaps if len(gap) not in common]
    return b"".join(parts)


def _scattered(body: bytes, count: int) -> list[bytes]:
    """The inverse of `_gathered`, for a number of gaps."""
    reader = Reader(body)
    runs = [(reader.number(), reader.number()) for _ in range(min(reader.number(), len(body)))]
    if sum(times for _, times in runs) != count:
        raise InputError(_DAMAGED)
    lengths = np.repeat([length for length, _ in runs], [times for _, times in runs])
    if sum(length * times for length, times in runs) > len(body):
        raise InputError(_DAMAGED)
    alike: dict[int, Iterator[bytes]] = {}
    for length in _common(lengths):
        rows = int(np.count_nonzero(lengths == length))
        planes = np.frombuffer(reader.take(length * rows), np.uint8)
        alike[length] = iter([row.tobytes() for row in _rows(planes, rows, length)])
    found = [
        next(alike[length]) if length in alike else reader.take(length)
        for length in lengths.tolist()
    ]
    if reader.rest():
        raise InputError(_DAMAGED)
    return found


def _common(lengths: NDArray[np.int64]) -> list[int]:
    """Lengths above 0 that several gaps have, the most frequent first."""
    values, counts = np.unique(lengths, return_counts=True)
    order = np.lexsort((values, -counts))
    return [int(values[k]) for k in order if values[k] > 0 and counts[k] > 1][:_GROUPS]


def _columns(rows: Bytes) -> bytes:
    """Headers (n, length), as differences of their words from row to row, byte by byte."""
    words, rest = _words(rows)
    words = np.diff(words, axis=0, prepend=np.zeros_like(words[:1]))
    rest = np.diff(rest, axis=0, prepend=np.zeros_like(rest[:1]))
    planes = np.concatenate([words.view(np.uint8).reshape(len(rows), -1), rest], axis=1)
    return planes.T.tobytes()


def _rows(planes: Bytes, count: int, length: int) -> Bytes:
    """The inverse of `_columns`."""
    words, rest = _words(np.ascontiguousarray(planes.reshape(length, count).T))
    words = np.cumsum(words, axis=0, dtype="<u4")
    rest = np.cumsum(rest, axis=0, dtype=np.uint8)
    whole = words.astype("<u4").view(np.uint8).reshape(count, -1)
    rows: Bytes = np.concatenate([whole, rest], axis=1)
    return rows


def _words(rows: Bytes) -> tuple[NDArray[np.uint32], Bytes]:
    """Rows as little-endian words, and what is left of each."""
    whole = rows.shape[1] // 4 * 4
    words = np.ascontiguousarray(rows[:, :whole]).view("<u4").reshape(len(rows), -1)
    return words, np.ascontiguousarray(rows[:, whole:])


def _packed(raw: bytes, options: dict[str, int] | None = None) -> bytes:
    """Bytes by LZMA, after their number."""
    filters = [{**_filter(len(raw)), **(options or {})}]
    return base_128(len(raw)) + lzma.compress(raw, lzma.FORMAT_RAW, filters=filters)


def _stored(raw: bytes) -> bytes:
    """As `_packed`, in chunks of LZMA2 that are not compressed."""
    chunks = (raw[first : first + _CHUNK] for first in range(0, len(raw), _CHUNK))
    parts = (b"\1" + (len(chunk) - 1).to_bytes(2, "big") + chunk for chunk in chunks)
    return base_128(len(raw)) + b"".join(parts) + b"\0"


def _filter(size: int) -> dict[str, int]:
    """LZMA2 of so many bytes, with no more memory to clear than they need."""
    needed = min(1 << max(size.bit_length(), 12), 1 << 24)
    return {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "dict_size": needed}


def _unpacked(reader: Reader, admit: Callable[[int], None]) -> bytes:
    """The bytes of `_packed`, whose number `admit` checks; InputError when they are damaged."""
    size = reader.number()
    if size > _MOST_RAW:
        raise InputError(_DAMAGED)
    admit(size)
    machine = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=[_filter(size)])
    try:
        raw = machine.decompress(reader.rest(), size + 1)
    except lzma.LZMAError as error:
        raise InputError(_DAMAGED) from error
    if len(raw) != size:
        raise InputError(_DAMAGED)
    return raw


class _Out:
    """Writes a recording, with the links of its pages where it has any."""

    def __init__(self, stream: IO[bytes], limits: _Limits) -> None:
        self._stream, self._limits = stream, limits
        self.check, self.size = 0, 0
        self._links: Bytes | None = None
        self._page, self._at = 0, 0

    def admit(self, size: int) -> None:
        """Refuse more bytes without links than a recording may have."""
        self._limits.check(self._at + size, self._limits.bytes, "bytes")

    def paged(self, body: bytes) -> None:
        """From the beginning on, insert the links of a record, one at the start of each page."""
        reader = Reader(body)
        page = reader.number()
        if self._at or self._page or not _SMALLEST_PAGE <= page <= _LARGEST_PAGE:
            raise InputError(_DAMAGED)
        links = _unpacked(reader, lambda size: self.admit(size // _LINK * (page - _LINK)))
        if len(links) % _LINK:
            raise InputError(_DAMAGED)
        self._page, self._links = page - _LINK, _unlinked(links)

    def write(self, data: bytes) -> None:
        """Write bytes of the recording without links."""
        rest = memoryview(data)
        while self._links is not None and rest:
            number, within = divmod(self._at, self._page)
            if within == 0:
                if number >= len(self._links):
                    raise InputError(_DAMAGED)
                self._put(self._links[number].tobytes())
            part = rest[: self._page - within]
            self._put(part)
            self._at += len(part)
            rest = rest[len(part) :]
        self._put(rest)
        self._at += len(rest)

    def _put(self, data: bytes | memoryview) -> None:
        self.check = zlib.crc32(data, self.check)
        self.size += len(data)
        self._stream.write(data)


def _restore(source: IO[bytes], stream: IO[bytes], limits: _Limits, tell: Tell) -> Account:
    """Write the recording of the records of `source`."""
    account, packets = Account(compressed=limits.size), _PacketDecoder()
    out = _Out(stream, limits)
    account.ranges = _ranges_of(source)
    limits.check(account.ranges, limits.ranges, "ranges")
    source.seek(0)
    for record in read_records(source):
        if record.kind != RecordKind.END:
            tell(source.tell(), limits.size)
        if record.kind == RecordKind.PAGES:
            out.paged(record.body)
        elif record.kind == RecordKind.LAYOUT:
            packets.begin(record.body)
        elif record.kind == RecordKind.TURN:
            account.returns += packets.turn(record.body)
            account.turns += 1
        elif record.kind == RecordKind.GAPS:
            account.packets += packets.write(record.body, out)
        elif record.body != out.size.to_bytes(8, "little") + out.check.to_bytes(4, "little"):
            raise InputError("the stream is damaged, or holds no recording")
    tell(limits.size, limits.size)
    account.bytes = out.size
    return account


def _ranges_of(source: IO[bytes]) -> int:
    """Ranges of all turns of a stream, none of which is decoded."""
    ranges, layout = 0, None
    for record in read_records(source):
        if record.kind == RecordKind.LAYOUT:
            layout = decode_layout(record.body)[0]
        elif record.kind == RecordKind.TURN:
            if layout is None:
                raise InputError(_DAMAGED)
            ranges += count_ranges(layout, record.body)
    return ranges


class _PacketDecoder:
    """Decodes turns until what lies between their packets follows."""

    def __init__(self) -> None:
        self._kind: PacketKind | None = None
        self._turns: TurnDecoder | None = None
        self._waiting: list[Payloads] = []
        self._bytes = 0

    def begin(self, body: bytes) -> None:
        """Go on with another layout."""
        layout, ends = decode_layout(body)
        if len(ends) != 2:
            raise InputError("the stream holds turns, but no packets")
        known = packet_kind(*ends)
        # The order of the lasers is the stream's own: tables of sensors may change.
        if layout != replace(known.layout, order=layout.order):
            raise InputError(_DAMAGED)
        self._kind, self._turns = replace(known, layout=layout), TurnDecoder(layout)

    def turn(self, body: bytes) -> int:
        """Decode a turn; its number of returns."""
        if self._turns is None or self._kind is None:
            raise InputError(_DAMAGED)
        turn = self._turns.decode(body)
        self._waiting.append(packets_of(self._kind, turn))
        self._bytes += self._waiting[-1].size
        if self._bytes > 2 * _WINDOW:
            raise InputError(_DAMAGED)
        return turn.returns

    def write(self, body: bytes, out: _Out) -> int:
        """Write the packets that wait, and what lies between them; their number."""
        packets = [row.tobytes() for payloads in self._waiting for row in payloads]
        self._waiting, self._bytes = [], 0
        reader = Reader(body)
        if reader.number() != len(packets):
            raise InputError(_DAMAGED)
        gaps = _scattered(_unpacked(reader, out.admit), len(packets) + 1)
        out.write(b"".join(part for pair in zip(gaps, packets, strict=False) for part in pair))
        out.write(gaps[-1])
        return len(packets)


def account_of(account: Account) -> dict[str, Any]:
    """What a command prints."""
    share = account.compressed / account.bytes if account.bytes else 1.0
    return {
        "bytes": account.bytes,
        "compressed_bytes": account.compressed,
        "share": round(share, 4),
        "packets": account.packets,
        "turns": account.turns,
        "returns": account.returns,
    }
