"""Packet captures (.pcap and .pcapng, as tcpdump and Wireshark write them) as UDP datagrams."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from ipaddress import ip_address
from struct import unpack_from
from typing import NamedTuple

from puckbench.core.errors import InputError
from puckbench.io.recordings.frames import Frames, is_capture

_ETHERNET = 1
_TYPED = {_ETHERNET: (12, 14), 113: (14, 16), 276: (0, 20)}
"""Link types whose header has an EtherType: where it stands, and bytes of the header."""
_RAW = (12, 14, 101, 228, 229)
_LOOPBACK = (0, 108)
_LINKS = "Ethernet (1), loopback (0, 108), raw IP (12, 14, 101, 228, 229), Linux cooked (113, 276)"
_INTERNET = (0x0800, 0x86DD)
_VLANS = (0x8100, 0x88A8)
_FAMILIES = (2, 10, 23, 24, 28, 30)
"""Numbers that systems give to IPv4 (2) and to IPv6."""
_UDP, _FRAGMENT = 17, 44
_EXTENSIONS = (0, 43, 60)
"""Headers between IPv6 and what it carries: hop-by-hop options, routing, destination options."""
_MOST_LISTED = 4


class Stream(NamedTuple):
    """From which address and port datagrams are sent, and to which."""

    sender: str
    sender_port: int
    receiver: str
    receiver_port: int

    def __str__(self) -> str:
        return f"{self.sender}:{self.sender_port} to {self.receiver}:{self.receiver_port}"


class Datagram(NamedTuple):
    """A UDP datagram.

    length: bytes that the payload had when it was sent. received: s since 1970.
    """

    stream: Stream
    payload: bytes
    length: int
    received: float = 0.0


@dataclass(frozen=True)
class Capture:
    """The whole UDP datagrams of a packet capture, and what else is in the file.

    Parameters
    ----------
    datagrams
        Those that are whole.
    cut
        Number of packets that the snap length cut.
    cut_sizes
        How many of these were datagrams of a length in bytes to a port.
    fragments
        Number of fragments of IP packets.
    others
        Number of packets of other protocols.
    bytes_cut_off
        Bytes of a last packet that is not whole.
    """

    datagrams: list[Datagram]
    cut: int
    cut_sizes: Mapping[tuple[int, int], int]
    fragments: int
    others: int
    bytes_cut_off: int

    def contents(self) -> str:
        """What the capture holds, as part of a sentence."""
        sizes = Counter((one.length, one.stream.receiver_port) for one in self.datagrams)
        cut = "; ".join(_listed(self.cut_sizes))
        counts = {
            f"packets cut by the snap length{f' ({cut})' if cut else ''}": self.cut,
            "fragments of IP packets": self.fragments,
            "packets of other protocols": self.others,
            "bytes of a packet that is not whole": self.bytes_cut_off,
        }
        rest = [f"{count:,} {what}" for what, count in counts.items() if count]
        return ", ".join([*_listed(sizes), *rest]) or "no packet"


def read_datagrams(data: bytes) -> Capture:
    """Read the UDP datagrams over IPv4 and IPv6 of a capture file's bytes.

    A file that is cut short gives its whole packets.

    Raises
    ------
    InputError
        It is no packet capture, or one of other link layers alone.
    """
    if not is_capture(data):
        raise InputError("not a packet capture (.pcap, .pcapng)")
    frames, datagrams = Frames(data), list[Datagram]()
    cut, fragments, others = 0, 0, 0
    cut_sizes: Counter[tuple[int, int]] = Counter()
    for frame in frames:
        content = data[frame.start : frame.end]
        packet = _ip_packet(content, frame.link)
        datagram = None if packet is None else _datagram(content, packet, frame.received)
        if datagram is not None and len(datagram.payload) == datagram.length:
            datagrams.append(datagram)
        elif packet is not None and packet.is_fragment:
            fragments += 1
        elif datagram is not None or len(content) < frame.length:
            cut += 1
            if datagram is not None:
                cut_sizes[datagram.length, datagram.stream.receiver_port] += 1
        else:
            others += 1
    _check_links(frames.links)
    rest = len(data) - frames.end
    return Capture(datagrams, cut, cut_sizes, fragments, others + frames.unreadable, rest)


def udp_datagram(frame: bytes, link: int = _ETHERNET) -> Datagram | None:
    """The UDP datagram of a frame, or None for something else or a fragment.

    The payload is shorter than its length where the frame is cut.
    """
    packet = _ip_packet(frame, link)
    return None if packet is None else _datagram(frame, packet)


class _IpPacket(NamedTuple):
    addresses: bytes
    protocol: int
    is_fragment: bool
    payload: int


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
    is_fragment = bool(unpack_from(">H", frame, start + 6)[0] & 0x3FFF)
    addresses = frame[start + 12 : start + 20]
    return _IpPacket(addresses, frame[start + 9], is_fragment, start + header)


def _ipv6(frame: bytes, start: int) -> _IpPacket:
    protocol, at = frame[start + 6], start + 40
    while protocol in _EXTENSIONS and at + 8 <= len(frame):
        protocol, at = frame[at], at + 8 + 8 * frame[at + 1]
    addresses = frame[start + 8 : start + 40]
    return _IpPacket(addresses, protocol, protocol == _FRAGMENT, at)


def _datagram(frame: bytes, packet: _IpPacket, received: float = 0.0) -> Datagram | None:
    start = packet.payload + 8
    if packet.protocol != _UDP or packet.is_fragment or len(frame) < start:
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
    """Where the IP header starts; None when the frame holds another protocol."""
    if link in _RAW:
        return 0
    if link in _LOOPBACK:
        is_ip = any(int.from_bytes(frame[:4], order) in _FAMILIES for order in ("little", "big"))
        return 4 if is_ip else None
    at, start = _TYPED.get(link, (0, len(frame)))
    while start + 4 <= len(frame):
        kind = unpack_from(">H", frame, at)[0]
        if kind not in _VLANS:
            return start if kind in _INTERNET else None
        at, start = start + 2, start + 4
    return None


def _check_links(links: set[int]) -> None:
    known = (*_TYPED, *_RAW, *_LOOPBACK)
    if links and not links.intersection(known):
        types = ", ".join(map(str, sorted(links)))
        raise InputError(f"a capture of link type {types}, where one of {_LINKS} is expected")


def _listed(sizes: Mapping[tuple[int, int], int]) -> Iterator[str]:
    """The most frequent lengths of datagrams and their ports, and how many others there are."""
    ordered = sorted(sizes.items(), key=lambda item: (-item[1], item[0]))
    for (length, port), count in ordered[:_MOST_LISTED]:
        what = "datagram" if count == 1 else "datagrams"
        yield f"{count:,} {what} of {length:,} bytes to port {port}"
    rest = sum(count for _, count in ordered[_MOST_LISTED:])
    if rest:
        yield f"{rest:,} other datagrams"
