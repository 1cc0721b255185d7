"""Capture files: packet captures of every byte order, ROS 2 bags, truncation, mutations."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointkit.column_tables import write_column_table
from pointkit.errors import InputError
from pointkit.lidar.return_table import read_return_table
from puck.recordings.data_packets import packets_of_capture
from puck.recordings.packet_turns import decode_packets
from puck.recordings.packets import MESSAGES, PACKET, SCAN, PacketLog
from puck.recordings.pcap import read_datagrams, udp_datagram
from puckbench.recordings.reading import read_packets, read_recording
from puckbench.recordings.writing import pcap_bytes
from tests.support.capture_bytes import ethernet, ipv4, payload, pcap, udp
from tests.support.capture_lookalike import box_capture, scan_message

LOG = box_capture(3)
PCAP = pcap_bytes(LOG)
RECORD = 16 + 42 + 1206


def log_of(data: bytes) -> PacketLog:
    """The data packets of a capture's bytes."""
    return packets_of_capture(read_datagrams(data))


def big_endian(data: bytes) -> bytes:
    """The capture as a big-endian machine writes it, with nanoseconds."""
    head = struct.unpack("<IHHiIII", data[:24])
    parts = [struct.pack(">IHHiIII", 0xA1B23C4D, *head[1:])]
    for at in range(24, len(data), RECORD):
        seconds, micros, length, original = struct.unpack_from("<IIII", data, at)
        parts.append(struct.pack(">IIII", seconds, micros * 1000, length, original))
        parts.append(data[at + 16 : at + RECORD])
    return b"".join(parts)


def bag(path: Path, messages: list[bytes], kind: str = "velodyne_msgs/msg/VelodyneScan") -> Path:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
            " serialization_format TEXT, offered_qos_profiles TEXT)"
        )
        connection.execute("CREATE TABLE messages(id INTEGER, topic_id, timestamp, data BLOB)")
        connection.execute(
            "INSERT INTO topics VALUES (1, '/velodyne_packets', ?, 'cdr', '')", (kind,)
        )
        rows = [(k, 1, 10 + k, message) for k, message in enumerate(messages)]
        connection.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
        connection.commit()
    return path


def test_packets_come_back_from_a_capture() -> None:
    log = log_of(PCAP)
    assert np.array_equal(log.payloads, LOG.payloads)
    assert log.received == pytest.approx(LOG.received, abs=1e-6)


def test_the_other_byte_order_and_nanoseconds_are_read() -> None:
    log = log_of(big_endian(PCAP))
    assert np.array_equal(log.payloads, LOG.payloads)
    assert log.received == pytest.approx(LOG.received, abs=1e-6)


def test_a_truncated_capture_gives_its_complete_packets() -> None:
    log = log_of(PCAP[:-100])
    assert len(log) == 2
    assert log.about["bytes_cut_off"] == RECORD - 100


def test_a_vlan_tag_is_skipped() -> None:
    frame = PCAP[40 : 24 + RECORD]
    tagged = frame[:12] + b"\x81\x00\x00\x05" + frame[12:]
    assert udp_datagram(tagged) == udp_datagram(frame)


def test_fragments_and_other_protocols_are_not_datagrams() -> None:
    frame = bytearray(PCAP[40 : 24 + RECORD])
    assert udp_datagram(bytes(frame[:20] + b"\x20\x00" + frame[22:])) is None
    assert udp_datagram(bytes(frame[:23] + b"\x06" + frame[24:])) is None
    assert udp_datagram(bytes(frame[:12] + b"\x08\x06" + frame[14:])) is None


def test_packets_of_other_sizes_are_counted() -> None:
    position = struct.pack("<IIII", 0, 0, 60, 60) + PCAP[40:100]
    assert log_of(PCAP + position).about["other_packets"] == 1


def test_other_packets_are_counted() -> None:
    others = [
        *(ethernet(bytes(40), 0x0806) for _ in range(2)),
        *(ethernet(ipv4(bytes(40), fragment=3)) for _ in range(3)),
        *(ethernet(ipv4(udp(bytes(48 + k)))) for k in range(4)),
        *(ethernet(ipv4(udp(bytes(1206)))) for _ in range(5)),
        *(ethernet(ipv4(udp(payload(k)))) for k in (1, 1, 2)),
        *(ethernet(ipv4(udp(bytes(1207)))) for _ in range(6)),
        *(ethernet(ipv4(udp(payload(k))))[:-1] for k in range(7)),
    ]
    log = log_of(pcap(*others))
    assert log.received.tolist() == [15, 17]
    assert log.about == {
        "format": "pcap",
        "other_packets": 2 + 3 + 4 + 5 + 6 + 7,
        "bytes_cut_off": 0,
        "foreign_packets": 5,
        "cut_packets": 7,
        "fragments": 3,
        "repeated_packets": 1,
    }


def test_two_sensors_in_one_capture_are_refused() -> None:
    other = PCAP[24 : 24 + RECORD].replace(bytes([192, 168, 1, 201]), bytes([192, 168, 1, 202]))
    with pytest.raises(InputError) as refused:
        log_of(PCAP + other)
    assert str(refused.value) == (
        "data packets of 2 streams (192.168.1.201:2368 to 255.255.255.255:2368, 3 packets of "
        "VLP-16; 192.168.1.202:2368 to 255.255.255.255:2368, 1 packet of VLP-16): choose one by "
        "--stream or the option stream"
    )


def test_of_many_sensors_four_are_named() -> None:
    own, packet = bytes([192, 168, 1, 201]), PCAP[24 : 24 + RECORD]
    others = [packet.replace(own, bytes([192, 168, 1, last])) for last in range(202, 206)]
    names = "; ".join(rf"192.168.1.{last}:2368 to [^;]*" for last in range(201, 205))
    with pytest.raises(InputError, match=rf"5 streams \({names}; \.\.\.\): choose one"):
        log_of(PCAP + b"".join(others))
    with pytest.raises(InputError, match=rf"4 streams \({names}\): choose one"):
        log_of(PCAP + b"".join(others[:3]))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a packet capture"),
        (b"PK\x03\x04" + bytes(100), "not a packet capture"),
        (b"\x0a\x0d\x0d\x0a" + bytes(100), "not a packet capture"),
        (PCAP[:20] + b"\x69\x00\x00\x00", "link type 105"),
        (PCAP[:24], r"no whole data packet of a Velodyne \(1,206 bytes\), but no packet: "),
    ],
)
def test_other_files_are_named_with_their_fault(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "a.pcap"
    path.write_bytes(data)
    with pytest.raises(InputError, match=f"a.pcap: .*{message}"):
        read_recording(path)


def test_a_missing_file_is_named_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^[^:]*gone\.pcap: no such file or directory$"):
        read_recording(tmp_path / "gone.pcap")


def test_packets_without_a_return_are_an_error(tmp_path: Path) -> None:
    packets = LOG.payloads.copy().view(PACKET)
    packets["blocks"]["returns"]["distance"] = 0
    dark = replace(LOG, payloads=packets.view(np.uint8))
    (tmp_path / "a.pcap").write_bytes(pcap_bytes(dark))
    with pytest.raises(InputError, match=r"a.pcap: no return in the recording"):
        read_recording(tmp_path / "a.pcap")


def test_an_interval_is_taken_by_time(tmp_path: Path) -> None:
    path = tmp_path / "a.pcap"
    path.write_bytes(PCAP)
    assert read_recording(path, start_s=0.001, end_s=0.002).about["packets"] == 1


def test_an_interval_without_packets_is_named(tmp_path: Path) -> None:
    packets = [ethernet(ipv4(udp(payload(k)))) for k in range(4)]
    (tmp_path / "a.pcap").write_bytes(pcap(*packets))
    with pytest.raises(InputError) as refused:
        read_recording(tmp_path / "a.pcap", start_s=3.5, end_s=9)
    fault = "no data packet from 3.5 to 9 s; the last is at 3 s"
    assert str(refused.value) == f"{tmp_path / 'a.pcap'}: {fault}"


def test_an_interval_of_a_table_has_its_first_instant_and_not_its_last(tmp_path: Path) -> None:
    table = decode_packets(LOG.payloads)
    later = {**table.columns, "timestamp": table["timestamp"] + 5}
    write_column_table(tmp_path / "a.parquet", replace(table, columns=later))
    table = read_return_table(tmp_path / "a.parquet")
    instants = np.unique(table["timestamp"])
    start, end = instants[[3, 10]] - instants[0]
    result = read_recording(tmp_path / "a.parquet", start_s=start, end_s=end)
    assert np.unique(result["timestamp"]).tolist() == instants[3:10].tolist()


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_bag_gives_the_packets_of_all_its_messages(tmp_path: Path, order: str) -> None:
    messages = [scan_message(LOG.payloads[:2], order), scan_message(LOG.payloads[2:], order)]
    log = read_packets(bag(tmp_path / "bag #1.db3", messages))
    assert np.array_equal(log.payloads, LOG.payloads)
    assert log.received.tolist() == [5.25, 6.25, 5.25]
    assert len(read_recording(tmp_path)) == len(decode_packets(LOG.payloads))


def test_a_bag_of_something_else_is_refused(tmp_path: Path) -> None:
    bag(tmp_path / "a.db3", [], "sensor_msgs/msg/Image")
    with pytest.raises(InputError, match=r"a.db3: the ROS bag must have one topic"):
        read_recording(tmp_path / "a.db3")
    bag(tmp_path / "b.db3", [])
    with pytest.raises(InputError, match=r"b.db3: the ROS bag has no data packet"):
        read_recording(tmp_path / "b.db3")


def test_a_damaged_data_base_is_refused(tmp_path: Path) -> None:
    data = bag(tmp_path / "a.db3", [scan_message(LOG.payloads)]).read_bytes()
    (tmp_path / "b.db3").write_bytes(data[:3000])
    with pytest.raises(InputError, match=r"b.db3: not a readable ROS bag"):
        read_recording(tmp_path / "b.db3")


def test_a_message_that_claims_more_packets_than_it_has_is_refused(tmp_path: Path) -> None:
    message = scan_message(LOG.payloads)
    for number, damaged in enumerate(
        (message[:-10], message[:28] + b"\xff\xff\xff\xff" + message[32:], b"\x07" * 40, b"")
    ):
        with pytest.raises(InputError, match=r"\d.db3: not a readable ROS bag"):
            read_recording(bag(tmp_path / f"{number}.db3", [damaged]))


def stores(writer: object, ros1: bool) -> tuple[Any, Any]:
    """A connection of a bag that is written, and the types of its messages."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in MESSAGES.items():
        types.register(get_types_from_msg(text, name))
    return writer.add_connection("/velodyne_packets", SCAN, typestore=types), types  # type: ignore[attr-defined]


def scan_of(types: Any, payloads: Any, ros1: bool) -> bytes:
    """A VelodyneScan of the payloads in the bag's serialisation."""
    time = types.types["builtin_interfaces/msg/Time"]
    head = {"seq": 0} if ros1 else {}
    header = types.types["std_msgs/msg/Header"](stamp=time(5, 0), frame_id="velodyne", **head)
    packet = types.types["velodyne_msgs/msg/VelodynePacket"]
    packets = [packet(time(5 + k, 250_000_000), payload) for k, payload in enumerate(payloads)]
    message = types.types[SCAN](header, packets)
    return bytes((types.serialize_ros1 if ros1 else types.serialize_cdr)(message, SCAN))


@pytest.mark.parametrize("compress", [False, True])
def test_a_ros_1_bag_gives_its_packets(tmp_path: Path, compress: bool) -> None:
    from rosbags.rosbag1 import Writer

    writer = Writer(tmp_path / "a.bag")
    if compress:
        writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer:
        connection, types = stores(writer, ros1=True)
        writer.write(connection, 10, scan_of(types, LOG.payloads, ros1=True))
    log = read_packets(tmp_path / "a.bag")
    assert np.array_equal(log.payloads, LOG.payloads)
    assert log.received.tolist() == [5.25, 6.25, 7.25]
    assert read_recording(tmp_path / "a.bag").about["format"] == "rosbag"


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_ros_2_bag_folders_and_their_files_are_read(tmp_path: Path, storage: str) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin[storage]) as writer:
        connection, types = stores(writer, ros1=False)
        writer.write(connection, 10, scan_of(types, LOG.payloads[:1], ros1=False))
        writer.write(connection, 20, scan_of(types, LOG.payloads[1:], ros1=False))
    file = next(path for path in (tmp_path / "bag").iterdir() if path.suffix != ".yaml")
    for path in (tmp_path / "bag", file):
        log = read_packets(path)
        assert np.array_equal(log.payloads, LOG.payloads)
        assert log.about == {"format": "ros2bag", "topic": "/velodyne_packets", "messages": 2}
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=rf"{file.name}: not a readable ROS bag"):
        read_recording(file)


def test_a_pcapng_capture_gives_the_same_packets(tmp_path: Path) -> None:
    import dpkt

    with (tmp_path / "a.pcapng").open("wb") as stream:
        writer = dpkt.pcapng.Writer(stream)
        for at in range(24, len(PCAP), RECORD):
            seconds, micros = struct.unpack_from("<II", PCAP, at)
            writer.writepkt(PCAP[at + 16 : at + RECORD], seconds + micros * 1e-6)
    data = (tmp_path / "a.pcapng").read_bytes()
    log = log_of(data)
    assert np.array_equal(log.payloads, LOG.payloads)
    assert log.received == pytest.approx(LOG.received, abs=1e-6)
    assert log.about == {"format": "pcap", "other_packets": 0, "bytes_cut_off": 0}
    cut = log_of(data[:-100])
    assert len(cut) == 2
    assert cut.about["bytes_cut_off"] > 0


def mutated(data: bytes, changes: list[tuple[int, int]], length: int) -> bytes:
    changed = bytearray(data)
    for at, value in changes:
        changed[at % len(changed)] = value
    return bytes(changed[: length % (len(changed) + 1)])


CHANGES = st.lists(
    st.tuples(
        st.one_of(st.integers(0, 80), st.integers(0, len(PCAP)), st.integers(-1210, -1)),
        st.integers(0, 255),
    ),
    max_size=6,
)
LENGTH = st.one_of(st.just(-1), st.integers(0, 4000))


@given(CHANGES, LENGTH)
@example([], -1)
@settings(max_examples=300)
def test_a_mutated_capture_is_a_table_or_an_error(
    changes: list[tuple[int, int]], length: int
) -> None:
    data = mutated(PCAP, changes, length)
    try:
        table = decode_packets(log_of(data).payloads)
    except InputError:
        return
    assert len(table) <= 3 * 384
    assert np.isfinite(table.xyz).all()


@given(CHANGES, LENGTH, st.sampled_from("<>"))
@example([], -1, "<")
@settings(max_examples=100)
def test_a_mutated_message_is_packets_or_an_error(
    tmp_path_factory: pytest.TempPathFactory,
    changes: list[tuple[int, int]],
    length: int,
    order: str,
) -> None:
    data = mutated(scan_message(LOG.payloads, order), changes, length)
    try:
        log = read_packets(bag(tmp_path_factory.mktemp("bag") / "a.db3", [data]))
    except InputError:
        return
    assert log.payloads.shape == (len(log), 1206)
    assert log.payloads.nbytes <= len(data) + 2


@given(
    st.lists(st.tuples(st.integers(0, 1 << 14), st.integers(0, 255)), max_size=8),
    st.one_of(st.just(-1), st.integers(16, 1 << 14)),
)
@settings(max_examples=100)
def test_a_mutated_bag_is_packets_or_an_error(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[int, int]], length: int
) -> None:
    folder = tmp_path_factory.mktemp("bag")
    data = bag(folder / "a.db3", [scan_message(LOG.payloads)]).read_bytes()
    (folder / "b.db3").write_bytes(mutated(data, changes, length))
    try:
        log = read_packets(folder / "b.db3")
    except InputError:
        return
    assert log.payloads.nbytes <= len(data)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_datagram_or_none(frame: bytes) -> None:
    datagram = udp_datagram(frame)
    assert datagram is None or len(datagram.payload) <= len(frame)
