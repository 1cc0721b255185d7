"""Packet captures as every system writes them, and clouds of other decoders."""

from __future__ import annotations

import struct
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from puck.recordings.packet_turns import decode_packets
from puck.recordings.packets import PACKET, PacketLog
from puckbench.recordings.writing import pcap_bytes
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
    payload,
    pcap,
    point,
    section,
    simple_packet,
    statistics,
    udp,
)
from tests.support.capture_lookalike import box_capture
from tests.support.corpus_case import Case, content

# Hop-by-hop options of 8 bytes, then destination options of 16, before UDP.
OPTIONS = b"\x3c\x00" + bytes(6) + b"\x11\x01" + bytes(14)
BOTH = [point(0), point(1)]
FRAMES = (frame(0), frame(1))
Returns = partial(Case, reader="returns")


def linked(link: int, order: str = "<", version: int = 4) -> bytes:
    wrap = ipv4 if version == 4 else ipv6
    return pcap(*(framed(link, wrap(udp(payload(k))), order) for k in (0, 1)), link=link)


def tagged(data: bytes) -> bytes:
    """A frame with an outer and an inner VLAN tag."""
    return data[:12] + b"\x88\xa8\x00\x05\x81\x00\x00\x07" + data[12:]


def fragments(size: int, count: int) -> list[bytes]:
    """Frames of fragments of an IP packet; each has 8 times 185 bytes."""
    first = [ethernet(ipv4(bytes(size), fragment=0x2000 | 185 * k)) for k in range(count - 1)]
    return [*first, ethernet(ipv4(bytes(size), fragment=185 * (count - 1)))]


LINKS = [
    *((f"link{link}.pcap", linked(link)) for link in (1, 12, 14, 101, 113, 228, 276)),
    *((f"link{link}.pcap", linked(link)) for link in (0,)),
    ("link0_big_endian.pcap", linked(0, ">")),
    ("link108.pcap", linked(108, ">")),
    *((f"link{link}_ipv6.pcap", linked(link, version=6)) for link in (0, 1, 113, 229, 276)),
    ("link1_fcs.pcap", pcap(*FRAMES, link=0x24000001)),
    ("vlan_in_vlan.pcap", pcap(*map(tagged, FRAMES))),
    ("trailer.pcap", pcap(*(one + b"\x12\x34\x56\x78" for one in FRAMES))),
    ("big_endian.pcap", pcap(*FRAMES, order=">")),
    ("nanoseconds.pcap", pcap(*FRAMES, magic=0xA1B23C4D)),
    ("modified.pcap", pcap(*FRAMES, magic=0xA1B2CD34)),
    ("modified_big_endian.pcap", pcap(*FRAMES, magic=0xA1B2CD34, order=">")),
    (
        "ipv6_options.pcap",
        pcap(*(ethernet(ipv6(OPTIONS + udp(payload(k)), kind=0), 0x86DD) for k in (0, 1))),
    ),
    ("statistics.pcapng", section() + interface() + b"".join(map(packet, FRAMES)) + statistics()),
    (
        "big_endian.pcapng",
        section(">") + interface(order=">") + b"".join(packet(one, order=">") for one in FRAMES),
    ),
    (
        "interfaces.pcapng",
        section()
        + interface(228, {9: b"\x09"})
        + interface(147)
        + interface(276, {2: b"lo", 9: b"\x94", 14: struct.pack("<q", 100)})
        + packet(ipv4(udp(payload(0))), 0, 10**9)
        + packet(b"of a user's link type", 1)
        + packet(framed(276, ipv4(udp(payload(1)))), 2, 2 << 20),
    ),
    (
        "sections.pcapng",
        section()
        + interface(147)
        + interface()
        + packet(frame(0), 1)
        + section(">")
        + interface(order=">")
        + packet(frame(1), order=">")
        + statistics(">"),
    ),
    (
        "blocks.pcapng",
        section()
        + block(4, bytes(8))
        + interface()
        + block(0x0BAD, b"any")
        + simple_packet(frame(0))
        + block(10, bytes(20))
        + old_packet(frame(1))
        + block(0x80000001, b""),
    ),
]
SNAPPED = section() + interface(snap=96) + simple_packet(frame(0), 96) + packet(frame(1), kept=20)
HDL64E = 6 * (b"\xff\xee" + bytes(98) + b"\xff\xdd" + bytes(98)) + bytes(6)
MIRRORED = pcap(*(one for one in FRAMES for _ in range(2)))
PORTS = pcap(*(ethernet(ipv4(udp(payload(k), target=2368 + k))) for k in (0, 1, 0)))
SENDERS = pcap(*(ethernet(ipv4(udp(payload(k)), f"192.168.1.20{k}")) for k in (0, 1)))
FOREIGN = ethernet(ipv4(udp(bytes(range(201)) * 6, 5000, 5001)))
DAMAGED = ethernet(ipv4(udp(payload(2)[:100] + b"\x00" + payload(2)[101:])))
OUSTER = pcap(
    *[ethernet(ipv4(udp(bytes(6464), 7502, 7502)))] * 3, ethernet(ipv4(udp(bytes(48), 7503, 7503)))
)
CAPTURES = [
    *(Returns(name, content(data), points=BOTH) for name, data in LINKS),
    Returns(
        "mirrored.pcap",
        content(MIRRORED),
        points=BOTH,
        warning=r"mirrored.pcap: left out packets that repeat one before, byte by byte \(2\)$",
    ),
    Returns(
        "two_ports.pcap",
        content(PORTS),
        error=r"two_ports.pcap: data packets of 2 streams "
        r"\(192.168.1.201:2368 to 255.255.255.255:2368, 2 packets of VLP-16; "
        r"192.168.1.201:2368 to 255.255.255.255:2369, 1 packet of VLP-16\): choose one by --stream",
    ),
    Returns(
        "chosen_port.pcap",
        content(PORTS),
        points=[point(1)],
        options={"stream": "192.168.1.201:2368 to 255.255.255.255:2369"},
    ),
    Returns(
        "chosen_twice.pcap",
        content(PORTS),
        error=r"chosen_twice.pcap: data packets of 2 streams, 2 of them '192.168.1.201:2368' \(",
        options={"stream": "192.168.1.201:2368"},
    ),
    Returns(
        "chosen_none.pcap",
        content(PORTS),
        error=r"chosen_none.pcap: data packets of 2 streams, none of them '192.168.1.20' \(",
        options={"stream": "192.168.1.20"},
    ),
    *(
        Returns(file, content(SENDERS), points=[point(0)], options={"stream": stream})
        for file, stream in (
            ("chosen_sender.pcap", "192.168.1.200"),
            ("chosen_sender_port.pcap", "192.168.1.200:2368"),
        )
    ),
    Returns(
        "foreign.pcap",
        content(pcap(FOREIGN, *FRAMES, FOREIGN)),
        points=BOTH,
        warning=r"foreign.pcap: left out datagrams of 1,206 bytes that no Velodyne sent \(2\)$",
    ),
    Returns(
        "damaged.pcap",
        content(pcap(frame(0), DAMAGED, frame(1))),
        points=BOTH,
        warning=r"damaged.pcap: left out damaged packets \(1\)$",
    ),
    Returns(
        "unknown.pcap",
        content(pcap(*FRAMES, ethernet(ipv4(udp(payload(2, mode=0x12)))))),
        points=BOTH,
        warning=r"left out packets of unknown sensors or return modes \(1\)$",
    ),
    Returns(
        "unknown_alone.pcap",
        content(pcap(ethernet(ipv4(udp(payload(0, 0x12, 0x7F)))))),
        error=r"\(1 of product 0x7F and return mode 0x12\): recordings of VLP-16, ",
    ),
    Returns(
        "hdl64e.pcap",
        content(pcap(ethernet(ipv4(udp(HDL64E))))),
        error=r"no return in the recording$",
        warning=r"hdl64e.pcap: nominal angles and distances of an HDL-64E's lasers; put",
    ),
    Returns(
        "cut_off.pcap",
        content(pcap(*FRAMES, frame(2))[:-7]),
        points=BOTH,
        warning=r"left out bytes of a last packet that is not whole \(1,257\)$",
    ),
    Returns(
        "some_cut.pcap",
        content(pcap(*FRAMES, frame(2), ethernet(ipv4(udp(bytes(2000)))), snap=1300)[:-1]),
        points=[*BOTH, point(2)],
        warning=r"left out bytes of a last packet that is not whole \(1,315\)$",
    ),
    Returns(
        "one_cut.pcapng",
        content(
            section() + interface() + b"".join(map(packet, FRAMES)) + packet(frame(2), kept=99)
        ),
        points=BOTH,
        warning=r"one_cut.pcapng: left out packets cut by the snap length \(1\)$",
    ),
    Returns(
        "snap_length.pcap",
        content(pcap(*FRAMES, snap=96)),
        error=r"but 2 packets cut by the snap length \(2 datagrams of 1,206 bytes to port 2368\): "
        r"record whole packets \(tcpdump -s 0\)$",
    ),
    Returns(
        "snap_length.pcapng",
        content(SNAPPED),
        error=r"but 2 packets cut by the snap length \(1 datagram of 1,206 bytes to port 2368\): ",
    ),
    Returns(
        "ouster.pcap",
        content(OUSTER),
        error=r"ouster.pcap: 3 datagrams of 6,464 bytes, as an Ouster sends: put the metadata of "
        r"the sensor beside it \(ouster.json\)$",
    ),
    Returns(
        "fragments.pcap",
        content(pcap(*fragments(1480, 5)[1:], ethernet(ipv6(bytes(100), kind=44), 0x86DD))),
        error=r"1 packets of other protocols: other fragments are missing$",
    ),
    Returns(
        "arp.pcap",
        content(pcap(ethernet(bytes(28), 0x0806), ethernet(ipv4(bytes(20), protocol=6)))),
        error=r"but 2 packets of other protocols: ",
    ),
    Returns("nothing.pcap", content(pcap()), error=r"\(1,206 bytes\), but no packet: "),
    Returns(
        "wireless.pcap",
        content(pcap(bytes(100), link=105)),
        error=r"a capture of link type 105, where one of Ethernet \(1\), .* is expected",
    ),
    Returns(
        "notes.xyzw",
        content("nothing of the kind"),
        error=r"xyzw: not a packet capture \(.pcap, .pcapng\) or ROS bag \(.bag, .db3, .mcap\); "
        r"clouds and tables go by their suffixes$",
    ),
    Returns(
        "packed.pcap.gz",
        content(b"\x1f\x8b\x08" + bytes(20)),
        error=r"packed.pcap.gz: not a packet capture .*; packed by gzip: unpack it$",
    ),
]

LASERS = [k % 16 for k in range(64)]
ELEVATIONS = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]
AZIMUTH = np.radians(np.arange(64) * 0.8 + 17)
HEIGHTS = np.tan(np.radians(ELEVATIONS))[LASERS]
RING = np.column_stack([4 * np.sin(AZIMUTH), 4 * np.cos(AZIMUTH), 4 * HEIGHTS])
# 0.8 degrees in 222 us: 10 turns in a second.
TICKS = [222_222 * k for k in range(64)]


def csv(head: str, *columns: object) -> object:
    """Rows of x, y, z of the ring and further columns."""
    rows = zip(*RING.T.tolist(), *columns, strict=True)  # type: ignore[call-overload]
    return content("\n".join([head, *(",".join(map(repr, row)) for row in rows), ""]))


def las(path: Path) -> None:
    """A surveyed hill, whose points have user data 0."""
    import laspy

    points = laspy.create(point_format=1, file_version="1.2")
    points.header.scales = [0.001, 0.001, 0.001]
    points.x, points.y, points.z = np.array([[5, 6, 7], [1, 2, 3], [0.5, 0.6, 0.7]])
    points.write(path)


SECONDS = [ticks / 1e9 for ticks in TICKS]
RANKS = np.argsort(np.argsort(ELEVATIONS))[LASERS].tolist()
NO_UNIT = "x,y,z,laser,t\n3,4,-1.34,0,5\n3,4,-1.34,0,7\n"
Cloud = partial(Case, reader="returns", points=RING)
STAMP = 1_700_000_000
CLOUDS = [
    Cloud(
        f"times_{name}.csv",
        csv(f"x,y,z,laser_id,{name}", LASERS, TICKS),
        warning=f"times_{name}.csv: times in column {name}: ns$",
        fields={"timestamp": SECONDS},
    )
    for name in ("t", "time", "timestamp", "time_stamp", "offset_time", "gps_time")
]
CLOUDS += [
    Cloud(
        "us.csv",
        csv("x,y,z,laser,t", LASERS, [222 * k for k in range(64)]),
        warning="us.csv: times in column t: us$",
        fields={"timestamp": [222 * k / 1e6 for k in range(64)]},
    ),
    Cloud(
        "ns_since_1970.csv",
        csv("x,y,z,laser,t", LASERS, [STAMP * 10**9 + k for k in TICKS]),
        warning="times in column t: ns$",
        fields={"timestamp": SECONDS},
    ),
    Cloud(
        "ns_in_floats.csv",
        csv("x,y,z,laser,t", LASERS, [float(k) for k in TICKS]),
        warning="times in column t: ns$",
        fields={"timestamp": SECONDS},
    ),
    Cloud("seconds.csv", csv("x,y,z,laser,t", LASERS, SECONDS), fields={"timestamp": SECONDS}),
    Cloud(
        "whole_stamp.csv",
        csv("x,y,z,laser,t", LASERS, [12345] * 64),
        warning=r"whole_stamp.csv: column t has one time for all points \(12345\): its",
        fields={"timestamp": [0.0] * 64},
    ),
    Cloud(
        "shares.csv",
        csv("x,y,z,laser,t", LASERS, (AZIMUTH / 2 / np.pi % 1).tolist()),
        warning=r"column t has shares of a turn \(0\.0\d+ to 0\.187\d+\), which are no times: its",
        fields={"timestamp": [0.0] * 64},
    ),
    Cloud(
        "before_the_end.csv",
        csv("x,y,z,laser,t", LASERS, [second - 0.1 for second in SECONDS]),
        fields={"timestamp": [second - 0.1 for second in SECONDS]},
    ),
    Cloud(
        "leap.csv",
        csv("x,y,z,laser,t", LASERS, [second + 3600 * (second > 0.0099) for second in SECONDS]),
        warning=r"leap.csv: column t leaps by 3600 s after 0\.00977\d+ s$",
    ),
    Cloud(
        "lasers_from_1.csv",
        csv("x,y,z,laser", [laser + 1 for laser in LASERS]),
        error="column laser has a value that is not a laser of the VLP-16: 16, not 0 to 15$",
    ),
    *(
        Cloud(
            f"{name}.csv",
            csv("x,y,z,laser,intensity", LASERS, [value] * 63 + [0]),
            fields={"reflectivity": [-1] * 64},
            warning=f"{name}.csv: column intensity has {seen}, which are no reflectivities from 0",
        )
        for name, value, seen in (
            ("intensities_of_16_bits", 65535, "0 to 65535"),
            ("intensities_from_0_to_1", 0.5, r"0 to 0\.5"),
            ("negative_intensities", -20, "-20 to 0"),
        )
    ),
    Case(
        "no_unit.csv",
        content(NO_UNIT),
        "returns",
        error="column t has integers whose unit cannot be inferred: add --time-unit ns$",
    ),
    Case(
        "with_unit.csv",
        content(NO_UNIT),
        "returns",
        points=[(3, 4, -1.34)] * 2,
        options={"time_unit": "ms"},
        fields={"timestamp": [0, 0.002]},
    ),
    Cloud("laser_by_rank.csv", csv("x,y,z,laser_id", RANKS), fields={"laser_id": LASERS}),
    Cloud(
        "label_and_ring.csv", csv("x,y,z,label,ring", [3] * 64, RANKS), fields={"laser_id": LASERS}
    ),
    Case(
        "classes.csv",
        csv("x,y,z,label", [3] * 64),
        "returns",
        error=r"column label has no lasers: points of laser 3 lie 8\.0 degrees off its cone",
    ),
    Case(
        "survey.las",
        las,
        "returns",
        error=r"survey.las: column laser_id has no lasers: points of laser 0 lie 20\.3 degrees off",
    ),
    Case(
        "missing_returns.csv",
        content("x,y,z,laser\n3,4,-1.34,0\n0,0,0,1\n,,,2\n"),
        "returns",
        points=[(3, 4, -1.34)],
        warning=r"missing_returns.csv: left out 2 missing returns$",
    ),
]
CLOUDS += [
    Case(
        "no_stream.csv",
        content(NO_UNIT),
        "returns",
        error="no_stream.csv: stream '10.0.0.1': only packet captures have streams$",
        options={"stream": "10.0.0.1"},
    ),
    Case(
        "no_times.pcap",
        content(MIRRORED),
        "returns",
        error="no_times.pcap: time unit ns: only times of clouds have units$",
        options={"time_unit": "ns"},
    ),
]
SPUN = box_capture(100)
"""A VLP-16 at 10 Hz, over the full hour."""
ROWS = np.arange(len(SPUN))
TRUE = decode_packets(SPUN.payloads)
OF_PACKET = np.repeat(ROWS, 24 * 15)
"""The packet of each return."""


def turned_packets(azimuths: Any) -> Any:
    """The packets of `SPUN` with other azimuths."""
    table = SPUN.payloads.copy().view(PACKET)[:, 0]
    turned = table["blocks"]["azimuth"].astype(np.int64) + np.reshape(azimuths, (-1, 1))
    table["blocks"]["azimuth"] = turned % 36000
    return table.view(np.uint8).reshape(-1, 1206)


def sent(rows: Any, later_us: Any = 0, azimuths: Any = 0, received_s: Any = 0) -> bytes:
    """A capture of the packets `rows` of `SPUN`, with changed clocks and azimuths."""
    table = turned_packets(azimuths)[rows].view(PACKET)[:, 0]
    later = table["time_us"].astype(np.int64) + later_us
    table["time_us"] = later % (3600 * 10**6)
    received = 1e9 + 1327e-6 * np.arange(len(table)) + received_s
    return pcap_bytes(PacketLog(table.view(np.uint8).reshape(-1, 1206), received, {}))


def swapped(places: int) -> Any:
    """Packets of which every tenth comes `places` later."""
    return np.argsort(ROWS + (ROWS % 10 == 3) * (places + 0.5), kind="stable")


def spun(file: str, data: bytes, packets: Any = ROWS, **more: Any) -> Case:
    """Make a case of a capture that has the true returns of some packets."""
    rows = np.isin(OF_PACKET, packets)
    fields = {"timestamp": TRUE["timestamp"][rows]} if len(packets) == len(ROWS) else {}
    return Returns(file, content(data), points=TRUE.xyz[rows], **{"fields": fields, **more})


MOVED = (ROWS >= 50).astype(np.int64)
PACKETS = [
    spun("in_order.pcap", sent(ROWS)),
    *(
        spun(
            f"late_by_{places}.pcap",
            sent(swapped(places)),
            warning=f": sorted by the sensor's clock, as {late} packets are late$",
        )
        for places, late in ((1, 10), (4, 10), (30, 8))
    ),
    spun(
        "reversed.pcap",
        sent(ROWS[::-1]),
        warning="reversed.pcap: sorted by the sensor's clock, as 99 packets are late$",
    ),
    spun(
        "received_twice.pcap",
        sent(np.repeat(ROWS, 2)),
        warning=r"left out packets that repeat one before, byte by byte \(100\)$",
    ),
    Returns(
        "lost.pcap",
        content(sent(np.delete(ROWS, [20, 40, 41, 42]))),
        points=decode_packets(np.delete(SPUN.payloads, [20, 40, 41, 42], axis=0)).xyz,
        warning=r"lost.pcap: about 4 packets are lost \(at 2 of 96 packets, first packet 20\)$",
    ),
    spun(
        "gps_found.pcap",
        sent(ROWS, 754_000_000 * MOVED),
        warning=r"the sensor's clock leaps \(at packet 50: 754\.001 s\); times go on without",
    ),
    spun(
        "clock_back.pcap",
        sent(ROWS, -3_000_000 * MOVED),
        warning=r"the sensor's clock leaps \(at packet 50: -2\.99867 s\); times go on without",
    ),
    spun(
        "recorder_set_back.pcap",
        sent(ROWS, received_s=-3600.0 * MOVED),
        warning=r"recorder_set_back.pcap: times of reception go back \(at packet 50\)$",
    ),
    Returns(
        "encoder_leaps.pcap",
        content(sent(ROWS, azimuths=9000 * MOVED)),
        points=decode_packets(turned_packets(9000 * MOVED)).xyz,
        warning=r"the azimuth rises unevenly, not at 10 Hz \(at packet 50: 94\.78 degrees\)$",
    ),
    Returns(
        "turns_back.pcap",
        content(sent(ROWS, azimuths=-2 * 478 * ROWS)),
        error="turns_back.pcap: the azimuths of its packets fall, where those of a Velodyne rise$",
    ),
    Returns(
        "faster.pcap",
        content(sent(ROWS, azimuths=478 * np.maximum(ROWS - 60, 0))),
        points=decode_packets(turned_packets(478 * np.maximum(ROWS - 60, 0))).xyz,
        warning=r"rises unevenly, not at 10 Hz \(at 39 of 100 packets, first packet 61: 9\.56 deg",
    ),
]
CASES = [*CAPTURES, *CLOUDS, *PACKETS]
