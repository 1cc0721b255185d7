"""Packet captures (.pcap, as tcpdump and VeloView write them): the UDP payloads of a VLP-16."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from puckbench.core.errors import InputError
from puckbench.io.recordings.packet_log import PacketLog, joined
from puckbench.lidar.recordings.packets import PACKET_BYTES

PCAPNG = b"\x0a\x0d\x0d\x0a"
# First four bytes: byte order, and length of a tick of the fraction of a second.
MAGICS = {
    b"\xd4\xc3\xb2\xa1": ("<", 1e-6),
    b"\xa1\xb2\xc3\xd4": (">", 1e-6),
    b"\x4d\x3c\xb2\xa1": ("<", 1e-9),
    b"\xa1\xb2\x3c\x4d": (">", 1e-9),
}
_HEADER, _RECORD = 24, 16
_ETHERNET, _RAW_IP, _LINUX_COOKED = 1, 101, 113
_IPV4, _VLANS = 0x0800, (0x8100, 0x88A8)
_UDP = 17


class Datagram(NamedTuple):
    """Source address (four bytes) and payload of a UDP datagram."""

    source: bytes
    payload: bytes


@dataclass(frozen=True)
class _Record:
    time: float
    frame: bytes


def read_pcap(data: bytes) -> PacketLog:
    """Data packets of a capture file's bytes; a file cut short gives its whole packets.

    Packets of other sizes (the sensor's position packets among them) are counted in `about` as
    `other_packets`, bytes of a last packet that is not whole as `bytes_cut_off`.

    Raises InputError for another format, or data packets from several senders.
    """
    if data[:4] == PCAPNG:
        raise InputError("a pcapng capture: convert it first (editcap -F pcap IN OUT)")
    if data[:4] not in MAGICS or len(data) < _HEADER:
        raise InputError("not a packet capture (.pcap)")
    link: int = struct.unpack_from(MAGICS[data[:4]][0] + "I", data, 20)[0] & 0xFFFF
    if link not in (_ETHERNET, _RAW_IP, _LINUX_COOKED):
        raise InputError(f"a capture of link type {link}, where Ethernet (1) is expected")
    payloads, times, sources, end, others = [], [], set(), _HEADER, 0
    for record in _records(data):
        end += _RECORD + len(record.frame)
        datagram = udp_datagram(record.frame, link)
        if datagram is None or len(datagram.payload) != PACKET_BYTES:
            others += 1
            continue
        payloads.append(datagram.payload)
        times.append(record.time)
        sources.add(datagram.source)
    if len(sources) > 1:
        names = ", ".join(sorted(".".join(map(str, source)) for source in sources)[:4])
        raise InputError(f"data packets of {len(sources)} senders ({names}): keep one of them")
    about = {"format": "pcap", "other_packets": others, "bytes_cut_off": len(data) - end}
    return joined(payloads, times, about)


def udp_datagram(frame: bytes, link: int = _ETHERNET) -> Datagram | None:
    """The UDP datagram of a frame over IPv4, or None: something else, a fragment, or cut short."""
    start = _ip_start(frame, link)
    if start is None or len(frame) < start + 28 or frame[start] >> 4 != 4:
        return None
    header = 4 * (frame[start] & 15)
    fragment: int = struct.unpack_from(">H", frame, start + 6)[0]
    udp = start + header
    if frame[start + 9] != _UDP or fragment & 0x3FFF or header < 20 or len(frame) < udp + 8:
        return None
    length: int = struct.unpack_from(">H", frame, udp + 4)[0]
    return Datagram(frame[start + 12 : start + 16], frame[udp + 8 : udp + max(length, 8)])


def _ip_start(frame: bytes, link: int) -> int | None:
    """Where the IPv4 header starts; None when the frame holds another protocol."""
    if link == _RAW_IP:
        return 0
    at = 12 if link == _ETHERNET else 14
    while len(frame) >= at + 4:
        kind: int = struct.unpack_from(">H", frame, at)[0]
        if kind not in _VLANS:
            return at + 2 if kind == _IPV4 else None
        at += 4
    return None


def _records(data: bytes) -> Iterator[_Record]:
    order, tick = MAGICS[data[:4]]
    at = _HEADER
    while at + _RECORD <= len(data):
        seconds, fraction, length, _ = struct.unpack_from(order + "IIII", data, at)
        at += _RECORD
        if at + length > len(data):
            return
        yield _Record(seconds + fraction * tick, data[at : at + length])
        at += length
