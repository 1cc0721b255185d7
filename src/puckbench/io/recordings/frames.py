"""Files of captured packets (pcap and pcapng) as frames, each with its link type and time.

dpkt takes all frames of a pcapng for those of one interface, and stops at blocks of some kinds.

References
----------
draft-ietf-opsawg-pcap, PCAP Capture File Format; draft-ietf-opsawg-pcapng, PCAP Next Generation
Capture File Format; tcpdump.org, Link-Layer Header Types.
"""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct, unpack_from
from typing import NamedTuple

_MAGICS = {
    0xA1B2C3D4: (10**6, 16),
    0xA1B23C4D: (10**9, 16),
    0xA1B2CD34: (10**6, 24),
}
"""Of a pcap: ticks of its clock in a second, and bytes of a record's header."""
_PCAP_HEADER = 24
_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET = 0x0A0D0D0A, 1, 2, 3, 6
_SECTION_START = b"\x0a\x0d\x0d\x0a"
_SECTION_ORDERS = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
_LEAST_BLOCK = 12
_RESOLUTION, _OFFSET = 9, 14
"""Options of an interface."""


class Frame(NamedTuple):
    """Where a captured packet lies in the bytes of its file.

    received: s since 1970. length: bytes that it had before the snap length cut it.
    """

    link: int
    received: float
    start: int
    end: int
    length: int


class Interface(NamedTuple):
    """An interface of a pcapng section: ticks of its clock in a second, s to add to its times."""

    link: int
    snap_length: int
    ticks: int
    offset_s: int


class Frames:
    """The frames of a file's bytes.

    After iteration, `end` is where the last whole record or block ends, `links` are the link types
    of the interfaces, and `unreadable` counts blocks of packets whose fields contradict each other.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.end = self.unreadable = 0
        self.links: set[int] = set()

    def __iter__(self) -> Iterator[Frame]:
        self.end = self.unreadable = 0
        layout = pcap_layout(self._data)
        return self._pcapng() if layout is None else self._pcap(*layout)

    def _pcap(self, order: str, ticks: int, header: int) -> Iterator[Frame]:
        link = unpack_from(order + "I", self._data, 20)[0] & 0xFFFF
        self.links, self.end = {link}, _PCAP_HEADER
        record = Struct(order + "IIII")
        while self.end + header <= len(self._data):
            seconds, fraction, captured, length = record.unpack_from(self._data, self.end)
            start, end = self.end + header, self.end + header + captured
            if end > len(self._data):
                return
            self.end = end
            yield Frame(link, seconds + fraction / ticks, start, end, length)

    def _pcapng(self) -> Iterator[Frame]:
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
                frame = _packet(self._data, kind, start, end, order, interfaces)
                if frame is None:
                    self.unreadable += 1
                    continue
                # A simple packet has no time: that of the one before stands for it.
                received = received if kind == _SIMPLE_PACKET else frame.received
                yield frame._replace(received=received)

    def _block(self, order: str) -> tuple[str, int, int, int] | None:
        """Byte order, type, and start and end of the body of the next block; None if cut off."""
        data, at = self._data, self.end
        if at + _LEAST_BLOCK > len(data):
            return None
        if data[at : at + 4] == _SECTION_START:
            order = _SECTION_ORDERS.get(data[at + 8 : at + 12], "")
        if not order:
            return None
        kind, size = unpack_from(order + "II", data, at)
        if not _LEAST_BLOCK <= size <= len(data) - at:
            return None
        end = at + size - 4
        is_whole = unpack_from(order + "I", data, end)[0] == size
        return (order, kind, at + 8, end) if is_whole else None


def is_capture(data: bytes) -> bool:
    """Whether bytes begin as a pcap or a pcapng file."""
    is_section = data.startswith(_SECTION_START) and data[8:12] in _SECTION_ORDERS
    return is_section or pcap_layout(data) is not None


def pcap_layout(data: bytes) -> tuple[str, int, int] | None:
    """Byte order, ticks of the clock in a second, and bytes of a record's header of a pcap."""
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
    """Codes and values of a block's options."""
    while at + 4 <= len(body):
        code, length = unpack_from(order + "HH", body, at)
        yield code, body[at + 4 : at + 4 + length]
        at += 4 + length + -length % 4


def _packet(
    data: bytes, kind: int, start: int, end: int, order: str, interfaces: list[Interface]
) -> Frame | None:
    """The frame of a block's body; None where its fields contradict each other."""
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
    return Frame(interface.link, received, start, start + captured, length)


def _simple_packet(
    data: bytes, start: int, end: int, order: str, interfaces: list[Interface]
) -> Frame | None:
    if end - start < 4 or not interfaces:
        return None
    length = unpack_from(order + "I", data, start)[0]
    start += 4
    captured = min(length, interfaces[0].snap_length or length)
    if captured > end - start:
        return None
    return Frame(interfaces[0].link, 0.0, start, start + captured, length)
