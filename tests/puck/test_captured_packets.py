"""Records of pcap files and blocks of pcapng files, laid out by hand after the specifications."""

from __future__ import annotations

import struct
from collections.abc import Callable
from random import Random

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from puck.recordings.captured_packets import CapturedPackets, is_packet_capture
from puck.recordings.pcap import read_datagrams, udp_datagram
from tests.support.capture_bytes import (
    block,
    ethernet,
    frame,
    framed,
    interface,
    ipv4,
    ipv6,
    old_packet,
    packet,
    pcap,
    section,
    simple_packet,
    statistics,
    udp,
)


def times(data: bytes) -> list[float]:
    return [item.received for item in CapturedPackets(data)]


def contents(data: bytes) -> list[tuple[int, bytes, int]]:
    """Link type, bytes and length of each packet."""
    return [(item.link, data[item.start : item.end], item.length) for item in CapturedPackets(data)]


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(
    ("magic", "ticks"), [(0xA1B2C3D4, 10**6), (0xA1B23C4D, 10**9), (0xA1B2CD34, 10**6)]
)
def test_records_of_a_pcap(order: str, magic: int, ticks: int) -> None:
    data = pcap(b"abc", b"defgh", link=0x40000071, order=order, magic=magic, snap=4, fraction=250)
    assert contents(data) == [(113, b"abc", 3), (113, b"defg", 5)]
    assert times(data) == [1 + 250 / ticks, 2 + 250 / ticks]
    assert is_packet_capture(data)
    assert is_packet_capture(data[:24])
    assert not is_packet_capture(data[:23])


@pytest.mark.parametrize("magic", [0xA1B2C3D4, 0xA1B2CD34])
def test_an_incomplete_record_ends_a_pcap(magic: int) -> None:
    data, first = pcap(b"abc", b"defgh", magic=magic), len(pcap(b"abc", magic=magic))
    for end in range(first, len(data)):
        frames = CapturedPackets(data[:end])
        assert len(list(frames)) == 1
        assert frames.end == first
    frames = CapturedPackets(data)
    assert len(list(frames)) == 2
    assert frames.end == len(data)
    assert frames.links == {1}


@pytest.mark.parametrize(
    ("options", "ticks", "offset"),
    [
        ({}, 10**6, 0),
        ({9: b"\x09"}, 10**9, 0),
        ({9: b"\x00"}, 1, 0),
        ({2: b"eth0", 9: b"\x03"}, 10**3, 0),
        ({9: b"\x80"}, 1, 0),
        ({9: b"\x8a", 14: struct.pack("<q", -5)}, 2**10, -5),
        ({14: struct.pack("<q", 1_700_000_000)}, 10**6, 1_700_000_000),
        ({9: b""}, 10**6, 0),
        ({14: b"\x01\x02"}, 10**6, 0),
    ],
)
def test_clocks_of_interfaces(options: dict[int, bytes], ticks: int, offset: int) -> None:
    count = (3 << 32) + 5
    data = section() + interface(1, options) + packet(b"a", ticks=count)
    data += old_packet(b"b", ticks=count)
    assert times(data) == [count / ticks + offset] * 2


@pytest.mark.parametrize("order", "<>")
def test_blocks_of_a_pcapng(order: str) -> None:
    blocks = [
        block(0x0BAD, b"", order),
        interface(228, {9: b"\x00"}, order),
        interface(113, None, order, snap=3),
        packet(b"abcde", 1, 7_000_000, order, kept=2),
        statistics(order),
        old_packet(b"fghi", 0, 9, order),
        simple_packet(b"jk", order=order),
        block(4, bytes(8), order),
    ]
    data = section(order) + b"".join(blocks)
    expected = [(113, b"ab", 5), (228, b"fghi", 4), (228, b"jk", 2)]
    assert contents(data) == expected
    # A simple packet has no time.
    assert times(data) == [7, 9, 9]
    assert contents(data + data) == 2 * expected
    frames = CapturedPackets(data)
    assert len(list(frames)) == 3
    assert (frames.end, frames.links, frames.unreadable) == (len(data), {113, 228}, 0)


def test_a_simple_packet_is_cut_by_the_first_interface() -> None:
    data = section() + interface(1, snap=3) + interface(1, snap=9) + simple_packet(b"abcdefgh", 3)
    assert contents(data) == [(1, b"abc", 8)]
    data = section() + interface(1, snap=9) + simple_packet(b"abcdefgh")
    assert contents(data) == [(1, b"abcdefgh", 8)]


def test_a_section_has_its_own_interfaces() -> None:
    data = section() + interface(101) + packet(b"a") + section() + packet(b"b") + statistics()
    frames = CapturedPackets(data)
    assert len(list(frames)) == 1
    assert frames.unreadable == 1
    assert frames.end == len(data)


def test_an_incomplete_block_ends_a_pcapng() -> None:
    first = section() + interface() + packet(b"abcd")
    data = first + packet(b"efgh")
    for end in range(len(first), len(data)):
        frames = CapturedPackets(data[:end])
        assert len(list(frames)) == 1
        assert frames.end == len(first)


@pytest.mark.parametrize(
    "fault",
    [
        struct.pack("<III", 6, 11, 11),
        struct.pack("<III", 6, 0, 0),
        struct.pack("<IIII", 6, 16, 0, 20),
        b"\x0a\x0d\x0d\x0a" + struct.pack("<IIIII", 28, 0, 0, 0, 28),
    ],
)
def test_a_damaged_block_ends_a_pcapng(fault: bytes) -> None:
    first = section() + interface() + packet(b"abcd")
    frames = CapturedPackets(first + fault + packet(b"efgh"))
    assert len(list(frames)) == 1
    assert frames.end == len(first)


@pytest.mark.parametrize(
    "fault",
    [
        packet(b"abcd", number=1),
        old_packet(b"abcd", number=1),
        block(6, bytes(16)),
        block(2, bytes(16)),
        block(6, struct.pack("<IIIII", 0, 0, 0, 5, 5) + b"abcd"),
        block(3, b""),
        block(3, struct.pack("<I", 5) + b"abcd"),
    ],
)
def test_an_inconsistent_packet_is_skipped(fault: bytes) -> None:
    frames = CapturedPackets(section() + interface() + fault + packet(b"efgh"))
    assert len(list(frames)) == 1
    assert frames.unreadable == 1
    whole = section() + interface() + fault + packet(frame())
    assert read_datagrams(whole).others == 1


@pytest.mark.parametrize("kind", [2, 3, 6])
def test_a_file_may_end_with_a_short_packet_block(kind: int) -> None:
    frames = CapturedPackets(section() + interface() + packet(b"abcd") + block(kind, b""))
    assert len(list(frames)) == 1
    assert frames.unreadable == 1


def test_a_packet_may_be_empty() -> None:
    data = section() + interface() + simple_packet(b"") + packet(b"") + old_packet(b"")
    assert contents(data) == [(1, b"", 0)] * 3


def test_a_simple_packet_needs_an_interface() -> None:
    frames = CapturedPackets(section() + simple_packet(b"abcd") + interface() + packet(b"efgh"))
    assert len(list(frames)) == 1
    assert frames.unreadable == 1


def test_a_packet_fills_its_block_to_the_last_byte() -> None:
    data = section() + interface() + packet(b"abcd") + simple_packet(b"efgh")
    assert [content for _, content, _ in contents(data)] == [b"abcd", b"efgh"]
    short = section() + block(1, struct.pack("<HHI", 1, 0, 0)) + block(1, bytes(4)) + packet(b"a")
    assert len(contents(short)) == 1


@pytest.mark.parametrize("data", [b"", b"\x0a\x0d\x0d\x0a" + bytes(24), bytes(24), b"PK" * 20])
def test_other_bytes_are_not_a_capture(data: bytes) -> None:
    assert not is_packet_capture(data)
    assert is_packet_capture(section())


def test_streams_are_identified_by_addresses_and_ports() -> None:
    four = udp_datagram(ethernet(ipv4(udp(b"abc", 5, 70), "10.0.0.1", "10.0.0.255")))
    assert four is not None
    assert f"{four.stream}" == "10.0.0.1:5 to 10.0.0.255:70"
    assert (four.payload, four.length) == (b"abc", 3)
    six = udp_datagram(ethernet(ipv6(udp(b"abc", 5, 70), "fe80::1", "ff02::1"), 0x86DD))
    assert six is not None
    assert f"{six.stream}" == "[fe80::1]:5 to [ff02::1]:70"
    assert six.payload == b"abc"


def test_a_cut_datagram_has_its_original_length() -> None:
    whole = ethernet(ipv4(udp(b"abcdef")))
    for end in (len(whole) - 6, len(whole) - 1):
        cut = udp_datagram(whole[:end])
        assert cut is not None
        assert (cut.payload, cut.length) == (b"abcdef"[: end - len(whole)], 6)
    assert udp_datagram(whole[: len(whole) - 7]) is None


@pytest.mark.parametrize("link", [0, 1, 12, 113, 228, 276])
@pytest.mark.parametrize("wrap", [ipv4, ipv6])
def test_a_packet_may_be_cut_anywhere(link: int, wrap: Callable[[bytes], bytes]) -> None:
    whole = framed(link, wrap(udp(b"abcdef")))
    lengths = [udp_datagram(whole[:end], link) for end in range(len(whole) + 1)]
    assert lengths[:-7] == [None] * (len(whole) - 6)
    assert [len(item.payload) for item in lengths[-7:] if item is not None] == list(range(7))


def test_headers_with_options_are_skipped() -> None:
    plain = ipv4(udp(b"abc"))
    optional = b"\x46" + plain[1:20] + bytes(4) + plain[20:]
    assert udp_datagram(ethernet(optional)) == udp_datagram(ethernet(plain))
    assert udp_datagram(ethernet(b"\x44" + plain[1:])) is None
    six = ipv6(b"\x11\x00" + bytes(6) + udp(b"abc"), kind=43)
    assert udp_datagram(framed(229, six), 229) == udp_datagram(framed(229, ipv6(udp(b"abc"))), 229)


@pytest.mark.parametrize("family", [2, 10, 23, 24, 28, 30])
def test_loopback_packets_have_their_family_in_either_byte_order(family: int) -> None:
    for order in "<>":
        data = struct.pack(f"{order}I", family) + ipv4(udp(b"abc"))
        assert udp_datagram(data, 0) == udp_datagram(ethernet(ipv4(udp(b"abc"))))
    assert udp_datagram(struct.pack("<I", 7) + ipv4(udp(b"abc")), 0) is None


def test_the_contents_of_a_capture_are_counted() -> None:
    many = [ethernet(ipv4(udp(bytes(10 + k), target=9))) for k in range(6) for _ in range(6 - k)]
    others = [
        ethernet(ipv4(bytes(64), fragment=0x2000)),
        ethernet(ipv4(bytes(64), fragment=1)),
        ethernet(ipv4(bytes(64), protocol=6)),
        ethernet(bytes(64), 0x0806),
        ethernet(ipv4(udp(bytes(10)), fragment=0x4000)),
    ]
    capture = read_datagrams(pcap(*many, *others) + b"abc")
    assert capture.contents() == (
        "6 datagrams of 10 bytes to port 9, 5 datagrams of 11 bytes to port 9, "
        "4 datagrams of 12 bytes to port 9, 3 datagrams of 13 bytes to port 9, 4 other datagrams, "
        "2 fragments of IP packets, 2 packets of other protocols, "
        "3 bytes of a packet that is not whole"
    )
    assert (capture.fragments, capture.others, capture.cut) == (2, 2, 0)


@given(
    st.binary(min_size=100, max_size=5000),
    st.integers(1, 60),
    st.sampled_from([4, 6]),
    st.randoms(use_true_random=False),
)
def test_fragments_of_a_datagram_are_joined_in_any_order(
    payload: bytes, eighths: int, version: int, random: Random
) -> None:
    whole = udp(payload)
    frames = []
    for at in range(0, len(whole), 8 * eighths):
        part, more = whole[at : at + 8 * eighths], at + 8 * eighths < len(whole)
        if version == 4:
            frames.append(ethernet(ipv4(part, fragment=0x2000 * more | at // 8) + bytes(3)))
        else:
            head = struct.pack(">BBHI", 17, 0, at | more, 99)
            frames.append(ethernet(ipv6(head + part, kind=44), 0x86DD))
    random.shuffle(frames)
    assume(len(frames) > 1)
    other = ethernet(ipv4(bytes(16), fragment=0x2010, protocol=6))
    capture = read_datagrams(pcap(frames[0], other, *frames[1:], frames[0]))
    (datagram,) = capture.datagrams
    assert datagram.payload == payload
    assert capture.fragments == 2


@given(st.binary(max_size=300), st.sampled_from(["pcap", "pcapng"]), st.integers(0, 200))
def test_random_bytes_after_a_header_are_read_to_an_end(rest: bytes, form: str, at: int) -> None:
    whole = pcap(frame()) if form == "pcap" else section() + interface() + packet(frame())
    data = whole[:at] + rest + whole[at:]
    frames = CapturedPackets(data)
    assert all(item.start <= item.end <= len(data) for item in frames)
    assert 0 <= frames.end <= len(data)
