"""Reader of link-layer packets in pcap and pcapng files.

The formats are those of the IETF drafts opsawg-pcap and opsawg-pcapng. The library dpkt is not
used, since it gives all packets of a pcapng file the clock of the first interface, and does not
tell what a truncated file lacks.
"""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct, unpack_from
from typing import NamedTuple

_MAGICS = {0xA1B2C3D4: (10**6, 16), 0xA1B23C4D: (10**9, 16), 0xA1B2CD34: (10**6, 24)}
"""For each magic number: clock ticks per second, and number of bytes of a record's header."""
_PCAP_HEADER = 24
_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET = 0x0A0D0D0A, 1, 2, 3, 6
_SECTION_START = b"\x0a\x0d\x0d\x0a"
_SECTION_ORDERS = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
_MIN_BLOCK_BYTES = 12
_RESOLUTION, _OFFSET = 9, 14
"""Codes of an interface's options."""


class CapturedPacket(NamedTuple):
    """A packet in a capture file.

    `start` and `end` are positions of the packet's bytes in the file, `length` is the number of
    bytes before truncation, `received` is the time of capture in seconds since 1970, and `link` is
    the link type.
    """

    link: int
    received: float
    start: int
    end: int
    length: int


class Interface(NamedTuple):
    """Interface of a pcapng file: link type, snap length, clock ticks per second, time offset."""

    link: int
    snap_length: int
    ticks: int
    offset_s: int


class CapturedPackets:
    """Iterable of the packets in the bytes of a pcap or pcapng file.

    After iteration, `end` is the position after the last complete record or block, `links` are the
    link types that occur, and `unreadable` is the number of inconsistent packet blocks.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.end = self.unreadable = 0
        self.links: set[int] = set()

    def __iter__(self) -> Iterator[CapturedPacket]:
        self.end = self.unreadable = 0
        layout = pcap_layout(self._data)
        return self._pcapng() if layout is None else self._pcap(*layout)

    def _pcap(self, order: str, ticks: int, header: int) -> Iterator[CapturedPacket]:
        link = unpack_from(order + "I", self._data, 20)[0] & 0xFFFF
        self.links, self.end = {link}, _PCAP_HEADER
        record = Struct(order + "IIII")
        while self.end + header <= len(self._data):
            seconds, fraction, captured, length = record.unpack_from(self._data, self.end)
            start, end = self.end + header, self.end + header + captured
            if end > len(self._data):
                return
            self.end = end
            yield CapturedPacket(link, seconds + fraction / ticks, start, end, length)

    def _pcapng(self) -> Iterator[CapturedPacket]:
        order, interfaces, received = "<", list[Interface](), 0.0
        while (block := self._block(order)) is not None:
            order, kind, start, end = block
            self.end = end + 4
            if kind == _SECTION:
                interfaces = []
            elif kind == _INTERFACE and end - start >= 8:
                interfaces.append(_interface(self._data[start:end], order))
                self.links.add(interfaces[-1].link)
            elif kind in (_OLD_PACKET, _SIMPLE_PACKET, _PACKET):
                packet = _packet(self._data, kind, start, end, order, interfaces)
                if packet is None:
                    self.unreadable += 1
                    continue
                # A simple packet has no time and takes that of the packet before.
                received = received if kind == _SIMPLE_PACKET else packet.received
                yield packet._replace(received=received)

    def _block(self, order: str) -> tuple[str, int, int, int] | None:
        """Return byte order, type, start and end of the next pcapng block, or None if truncated."""
        data, at = self._data, self.end
        if at + _MIN_BLOCK_BYTES > len(data):
            return None
        if data[at : at + 4] == _SECTION_START:
            order = _SECTION_ORDERS.get(data[at + 8 : at + 12], "")
        if not order:
            return None
        kind, size = unpack_from(order + "II", data, at)
        if not _MIN_BLOCK_BYTES <= size <= len(data) - at:
            return None
        end = at + size - 4
        is_complete = unpack_from(order + "I", data, end)[0] == size
        return (order, kind, at + 8, end) if is_complete else None


START_BYTES = 24
"""Number of bytes at the start of a file by which `is_packet_capture` judges it."""


def is_packet_capture(data: bytes) -> bool:
    """Return whether bytes begin like a pcap or pcapng file."""
    is_section = data.startswith(_SECTION_START) and data[8:12] in _SECTION_ORDERS
    return is_section or pcap_layout(data) is not None


def pcap_layout(data: bytes) -> tuple[str, int, int] | None:
    """Return how the records of a pcap file are laid out, or None if `data` is no pcap file.

    Returns
    -------
    order
        Byte order, ``<`` or ``>``.
    ticks
        Clock ticks per second.
    header
        Number of bytes of a record's header.
    """
    if len(data) < _PCAP_HEADER:
        return None
    for order in "<>":
        layout = _MAGICS.get(unpack_from(order + "I", data)[0])
        if layout is not None:
            return order, *layout
    return None


def _interface(body: bytes, order: str) -> Interface:
    link, snap_length = unpack_from(order + "HxxI", body)
    options = dict(_options(body, order))
    resolution, offset = options.get(_RESOLUTION, b"\x06"), options.get(_OFFSET, bytes(8))
    exponent = resolution[0] & 0x7F if resolution else 6
    ticks = 2**exponent if resolution[:1] >= b"\x80" else 10**exponent
    seconds = unpack_from(order + "q", offset)[0] if len(offset) == 8 else 0
    return Interface(link, snap_length, ticks, seconds)


def _options(body: bytes, order: str, at: int = 8) -> Iterator[tuple[int, bytes]]:
    while at + 4 <= len(body):
        code, length = unpack_from(order + "HH", body, at)
        yield code, body[at + 4 : at + 4 + length]
        at += 4 + length + -length % 4


def _packet(
    data: bytes, kind: int, start: int, end: int, order: str, interfaces: list[Interface]
) -> CapturedPacket | None:
    if kind == _SIMPLE_PACKET:
        return _simple_packet(data, start, end, order, interfaces)
    form = order + ("IIIII" if kind == _PACKET else "HxxIIII")
    if end - start < 20:
        return None
    number, high, low, captured, length = unpack_from(form, data, start)
    start += 20
    if number >= len(interfaces) or captured > end - start:
        return None
    interface = interfaces[number]
    received = (high << 32 | low) / interface.ticks + interface.offset_s
    return CapturedPacket(interface.link, received, start, start + captured, length)


def _simple_packet(
    data: bytes, start: int, end: int, order: str, interfaces: list[Interface]
) -> CapturedPacket | None:
    if end - start < 4 or not interfaces:
        return None
    length = unpack_from(order + "I", data, start)[0]
    start += 4
    captured = min(length, interfaces[0].snap_length or length)
    if captured > end - start:
        return None
    return CapturedPacket(interfaces[0].link, 0.0, start, start + captured, length)
