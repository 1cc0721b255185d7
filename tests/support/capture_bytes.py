"""Packet captures laid out by hand: link layers, IP, UDP, pcap records and pcapng blocks."""

from __future__ import annotations

import struct
from ipaddress import ip_address

import numpy as np

SENSOR, EVERYONE = "192.168.1.201", "255.255.255.255"
ETHERNET = b"\xff" * 6 + b"\x60\x76\x88\x00\x00\x01"


def payload(number: int = 0, mode: int = 0x37, product: int = 0x22) -> bytes:
    """A data packet whose only return is `point`; its time counts its number."""
    block = struct.pack("<HH", 0xEEFF, 1000 + 10 * number)
    first = block + struct.pack("<HB", 1000, 50) + bytes(93)
    end = struct.pack("<IBB", 1327 * number, mode, product)
    return first + 11 * (block + bytes(96)) + end


def point(number: int = 0) -> tuple[float, float, float]:
    """Laser 0 of a VLP-16, 15 degrees down and 11.2 mm up, at 2 m."""
    azimuth, elevation = np.radians(10 + number / 10), np.radians(-15)
    level = 2 * np.cos(elevation)
    return (
        level * np.sin(azimuth),
        level * np.cos(azimuth),
        2 * np.sin(elevation) + 0.0112,
    )


def udp(data: bytes, source: int = 2368, target: int = 2368) -> bytes:
    return struct.pack(">HHHH", source, target, 8 + len(data), 0) + data


def ipv4(
    data: bytes,
    sender: str = SENSOR,
    receiver: str = EVERYONE,
    fragment: int = 0,
    protocol: int = 17,
) -> bytes:
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(data), 7, fragment, 64, protocol, 0)
    return head + ip_address(sender).packed + ip_address(receiver).packed + data


def ipv6(data: bytes, sender: str = "fe80::1", receiver: str = "ff02::1", kind: int = 17) -> bytes:
    head = struct.pack(">IHBB", 6 << 28, len(data), kind, 64)
    return head + ip_address(sender).packed + ip_address(receiver).packed + data


def ethernet(data: bytes, kind: int = 0x0800) -> bytes:
    return ETHERNET + struct.pack(">H", kind) + data


def frame(number: int = 0) -> bytes:
    """An Ethernet frame of a data packet."""
    return ethernet(ipv4(udp(payload(number))))


def framed(link: int, data: bytes, order: str = "<") -> bytes:
    """An IP packet as frames of a link type have it; version 4 or 6 by its first byte."""
    is_four = data[0] >> 4 == 4
    kind = 0x0800 if is_four else 0x86DD
    if link == 1:
        return ethernet(data, kind)
    if link == 113:
        return struct.pack(">HHHQH", 4, 1, 6, 0, kind) + data
    if link == 276:
        return struct.pack(">HHIHBBQ", kind, 0, 3, 1, 4, 6, 0) + data
    if link in (0, 108):
        return struct.pack(f"{order}I", 2 if is_four else 30) + data
    return data


def pcap(
    *frames: bytes,
    link: int = 1,
    order: str = "<",
    magic: int = 0xA1B2C3D4,
    snap: int = 65535,
    fraction: int = 0,
    step_us: int = 10**6,
) -> bytes:
    """A pcap of frames, received 1, 2, ... steps (s) after 1970, each `fraction` ticks later."""
    parts = [struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, snap, link)]
    more = struct.pack(f"{order}IHBB", 1, 0x0800, 0, 0) if magic == 0xA1B2CD34 else b""
    for number, data in enumerate(frames, 1):
        kept = data[:snap]
        seconds, ticks = divmod(number * step_us, 10**6)
        parts.append(struct.pack(f"{order}IIII", seconds, ticks + fraction, len(kept), len(data)))
        parts += [more, kept]
    return b"".join(parts)


def block(kind: int, body: bytes, order: str = "<") -> bytes:
    """A block of a pcapng, its body padded to whole words."""
    body += bytes(-len(body) % 4)
    size = struct.pack(f"{order}I", 12 + len(body))
    return struct.pack(f"{order}I", kind) + size + body + size


def section(order: str = "<") -> bytes:
    return block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def interface(
    link: int = 1,
    options: dict[int, bytes] | None = None,
    order: str = "<",
    snap: int = 0,
) -> bytes:
    body = struct.pack(f"{order}HHI", link, 0, snap)
    for code, value in (options or {}).items():
        body += struct.pack(f"{order}HH", code, len(value)) + value + bytes(-len(value) % 4)
    return block(1, body + bytes(4 * bool(options)), order)


def packet(
    data: bytes, number: int = 0, ticks: int = 0, order: str = "<", kept: int = 1 << 20
) -> bytes:
    """An enhanced packet block."""
    times = (ticks >> 32, ticks & 0xFFFFFFFF)
    lengths = (min(len(data), kept), len(data))
    return block(6, struct.pack(f"{order}IIIII", number, *times, *lengths) + data[:kept], order)


def old_packet(data: bytes, number: int = 0, ticks: int = 0, order: str = "<") -> bytes:
    """A packet block, which the enhanced one replaced."""
    head = struct.pack(
        f"{order}HHIIII", number, 9, ticks >> 32, ticks & 0xFFFFFFFF, len(data), len(data)
    )
    return block(2, head + data, order)


def simple_packet(data: bytes, kept: int = 1 << 20, order: str = "<") -> bytes:
    return block(3, struct.pack(f"{order}I", len(data)) + data[:kept], order)


def statistics(order: str = "<") -> bytes:
    """An interface statistics block with the number of packets received."""
    options = struct.pack(f"{order}HHQ", 4, 8, 2) + bytes(4)
    return block(5, struct.pack(f"{order}III", 0, 0, 0) + options, order)
