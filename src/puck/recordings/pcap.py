"""Reader of UDP datagrams in packet captures (Ethernet, VLANs, IPv4, IPv6), also from fragments."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from ipaddress import ip_address
from itertools import accumulate
from struct import unpack_from
from typing import NamedTuple

from pointkit.errors import InputError
from puck.recordings.captured_packets import CapturedPackets, is_packet_capture

_ETHERNET = 1
_ETHER_TYPE_LINKS = {_ETHERNET: (12, 14), 113: (14, 16), 276: (0, 20)}
"""Position of the EtherType and size of the header, by link type."""
_RAW = (12, 14, 101, 228, 229)
_LOOPBACK = (0, 108)
_LINKS = "Ethernet (1), loopback (0, 108), raw IP (12, 14, 101, 228, 229), Linux cooked (113, 276)"
_INTERNET = (0x0800, 0x86DD)
_VLANS = (0x8100, 0x88A8)
_FAMILIES = (2, 10, 23, 24, 28, 30)
"""Address families of IPv4 (2) and, by operating system, of IPv6."""
_UDP, _FRAGMENT = 17, 44
_EXTENSIONS = (0, 43, 60)
"""IPv6 extension headers: hop-by-hop options, routing, destination options."""
_MAX_LISTED = 4


class Stream(NamedTuple):
    """Sender and receiver of datagrams, each with its port."""

    sender: str
    sender_port: int
    receiver: str
    receiver_port: int

    def __str__(self) -> str:
        return f"{self.sender}:{self.sender_port} to {self.receiver}:{self.receiver_port}"


def refuse_stream(name: str | None) -> None:
    """Raise InputError if `name`, which selects a stream, is set for a file without streams.

    Only packet captures have streams.
    """
    if name is not None:
        raise InputError(f"stream '{name}': only packet captures have streams")


class Datagram(NamedTuple):
    """A UDP datagram of a capture.

    The captured data may be shorter than `length`, the datagram's size in bytes when it was sent.
    The time `received` is in seconds since 1970.
    """

    stream: Stream
    payload: bytes
    length: int
    received: float = 0.0


@dataclass(frozen=True)
class Capture:
    """The complete UDP datagrams of a packet capture, and counts of what else it contains.

    Attributes
    ----------
    fragments
        Number of IP fragments whose datagrams are incomplete.
    cut
        Number of packets truncated by the snap length.
    cut_sizes
        Number of truncated packets by length in bytes and port.
    others
        Number of packets of other protocols.
    bytes_cut_off
        Size in bytes of an incomplete last packet.
    """

    datagrams: list[Datagram]
    cut: int
    cut_sizes: Mapping[tuple[int, int], int]
    fragments: int
    others: int
    bytes_cut_off: int

    def contents(self) -> str:
        """Describe what the capture holds for an error message, most frequent first."""
        sizes = Counter((each.length, each.stream.receiver_port) for each in self.datagrams)
        cut = "; ".join(_listed(self.cut_sizes))
        counts = {
            f"packets cut by the snap length{f' ({cut})' if cut else ''}": self.cut,
            "fragments of IP packets": self.fragments,
            "packets of other protocols": self.others,
            "bytes of a packet that is not whole": self.bytes_cut_off,
        }
        others = [f"{count:,} {name}" for name, count in counts.items() if count]
        return ", ".join([*_listed(sizes), *others]) or "no packet"


def read_datagrams(data: bytes) -> Capture:
    """Read the complete UDP datagrams of a packet capture.

    Parameters
    ----------
    data
        The bytes of the file (pcap or pcapng).

    Returns
    -------
    Capture
        The datagrams, and counts of other content.

    Raises
    ------
    InputError
        No link layer of the capture is supported.
    """
    if not is_packet_capture(data):
        raise InputError("not a packet capture (.pcap, .pcapng)")
    packets, datagrams, fragments = CapturedPackets(data), list[Datagram](), _Fragments()
    cut, others = 0, 0
    cut_sizes: Counter[tuple[int, int]] = Counter()
    for packet in packets:
        content = data[packet.start : packet.end]
        ip_packet = _ip_packet(content, packet.link)
        if ip_packet is not None and (fragment := ip_packet.fragment) is not None:
            content = fragments.joined(content, ip_packet, fragment)
            ip_packet = ip_packet._replace(fragment=None, payload=0)
            if not content:
                continue
        datagram = None if ip_packet is None else _datagram(content, ip_packet, packet.received)
        if datagram is not None and len(datagram.payload) == datagram.length:
            datagrams.append(datagram)
        elif datagram is not None or packet.end - packet.start < packet.length:
            cut += 1
            if datagram is not None:
                cut_sizes[datagram.length, datagram.stream.receiver_port] += 1
        else:
            others += 1
    _check_links(packets.links)
    remainder = len(data) - packets.end
    return Capture(
        datagrams, cut, cut_sizes, fragments.left, others + packets.unreadable, remainder
    )


def udp_datagram(content: bytes, link: int = _ETHERNET) -> Datagram | None:
    """Return the UDP datagram in a packet, or None for fragments and other protocols.

    The packet begins with the header of the link layer whose code is `link`, by default Ethernet.
    """
    packet = _ip_packet(content, link)
    return None if packet is None else _datagram(content, packet)


class _Fragment(NamedTuple):
    identification: bytes
    offset: int
    is_last: bool
    end: int
    """Byte offset of the fragment's end in the link-layer packet."""


class _IpPacket(NamedTuple):
    addresses: bytes
    protocol: int
    payload: int
    fragment: _Fragment | None = None


@dataclass
class _Parts:
    parts: dict[int, bytes] = field(default_factory=dict)
    count: int = 0
    size: int = 0
    whole: int | None = None

    def add(self, fragment: _Fragment, data: bytes) -> None:
        self.count += 1
        self.size += len(data) - len(self.parts.get(fragment.offset, b""))
        self.parts[fragment.offset] = data
        if fragment.is_last:
            self.whole = fragment.offset + len(data)

    def joined(self) -> bytes:
        """Return the packet's payload, or empty bytes if fragments are missing or overlap."""
        if self.size != self.whole:
            return b""
        parts = sorted(self.parts.items())
        starts = accumulate((len(data) for _, data in parts), initial=0)
        if any(offset != start for (offset, _), start in zip(parts, starts, strict=False)):
            return b""
        return b"".join(data for _, data in parts)


class _Fragments:
    """Joins the fragments of IP packets, which may come in any order (RFC 791, RFC 8200)."""

    def __init__(self) -> None:
        self._packets: dict[tuple[bytes, int, bytes], _Parts] = {}

    @property
    def left(self) -> int:
        return sum(packet.count for packet in self._packets.values())

    def joined(self, frame: bytes, packet: _IpPacket, fragment: _Fragment) -> bytes:
        """Add a fragment, and return the packet's payload if it is complete, or empty bytes."""
        key = (packet.addresses, packet.protocol, fragment.identification)
        parts = self._packets.setdefault(key, _Parts())
        parts.add(fragment, frame[packet.payload : fragment.end])
        content = parts.joined()
        if content:
            del self._packets[key]
        return content


def _ip_packet(frame: bytes, link: int) -> _IpPacket | None:
    start = _ip_start(frame, link)
    if start is None or len(frame) < start + 20:
        return None
    version = frame[start] >> 4
    if version == 4:
        return _ipv4(frame, start)
    return _ipv6(frame, start) if version == 6 and len(frame) >= start + 40 else None


def _ipv4(frame: bytes, start: int) -> _IpPacket | None:
    header = 4 * (frame[start] & 15)
    if header < 20:
        return None
    size, identification, place = unpack_from(">H2sH", frame, start + 2)
    addresses, fragment = frame[start + 12 : start + 20], None
    if place & 0x3FFF:
        end = start + size
        fragment = _Fragment(identification, 8 * (place & 0x1FFF), not place & 0x2000, end)
    return _IpPacket(addresses, frame[start + 9], start + header, fragment)


def _ipv6(frame: bytes, start: int) -> _IpPacket:
    protocol, at = frame[start + 6], start + 40
    while protocol in _EXTENSIONS and at + 8 <= len(frame):
        protocol, at = frame[at], at + 8 + 8 * frame[at + 1]
    addresses, fragment = frame[start + 8 : start + 40], None
    if protocol == _FRAGMENT and at + 8 <= len(frame):
        protocol, place, identification = unpack_from(">BxH4s", frame, at)
        end, at = start + 40 + unpack_from(">H", frame, start + 4)[0], at + 8
        fragment = _Fragment(identification, place & 0xFFF8, not place & 1, end)
    return _IpPacket(addresses, protocol, at, fragment)


def _datagram(frame: bytes, packet: _IpPacket, received: float = 0.0) -> Datagram | None:
    start = packet.payload + 8
    if packet.protocol != _UDP or packet.fragment or len(frame) < start:
        return None
    length = max(unpack_from(">H", frame, start - 4)[0] - 8, 0)
    stream = _stream(packet.addresses, frame[start - 8 : start - 4])
    return Datagram(stream, frame[start : start + length], length, received)


@lru_cache(maxsize=1 << 12)
def _stream(addresses: bytes, ports: bytes) -> Stream:
    half = len(addresses) // 2
    sender, receiver = unpack_from(">HH", ports)
    return Stream(_address(addresses[:half]), sender, _address(addresses[half:]), receiver)


def _address(raw: bytes) -> str:
    return f"{ip_address(raw)}" if len(raw) == 4 else f"[{ip_address(raw)}]"


def _ip_start(frame: bytes, link: int) -> int | None:
    if link in _RAW:
        return 0
    if link in _LOOPBACK:
        is_ip = any(int.from_bytes(frame[:4], order) in _FAMILIES for order in ("little", "big"))
        return 4 if is_ip else None
    at, start = _ETHER_TYPE_LINKS.get(link, (0, len(frame)))
    while start + 4 <= len(frame):
        kind = unpack_from(">H", frame, at)[0]
        if kind not in _VLANS:
            return start if kind in _INTERNET else None
        at, start = start + 2, start + 4
    return None


def _check_links(links: set[int]) -> None:
    if links and not links.intersection((*_ETHER_TYPE_LINKS, *_RAW, *_LOOPBACK)):
        types = ", ".join(map(str, sorted(links)))
        raise InputError(f"a capture of link type {types}, where one of {_LINKS} is expected")


def _listed(sizes: Mapping[tuple[int, int], int]) -> Iterator[str]:
    ordered = sorted(sizes.items(), key=lambda item: (-item[1], item[0]))
    for (length, port), count in ordered[:_MAX_LISTED]:
        noun = "datagram" if count == 1 else "datagrams"
        yield f"{count:,} {noun} of {length:,} bytes to port {port}"
    others = sum(count for _, count in ordered[_MAX_LISTED:])
    if others:
        yield f"{others:,} other datagrams"
