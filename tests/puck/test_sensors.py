"""Recordings of several sensors, and packets out of order: compressed as if each were alone."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.errors import InputError
from puck import CodingOptions, decode_turns, decompress, read_turns
from puck.recordings.packet_turns import split_turns, turn_of
from puck.records import Record, RecordKind, join_records, read_records
from tests.support.capture_bytes import ethernet, ipv4, ipv6, udp
from tests.support.capture_bytes import pcap as pcap_of_frames
from tests.support.spinning import (
    DUAL,
    HDL32E,
    HDL64E,
    PACKET,
    STRONGEST,
    VLP16,
    nothing_seen,
    pcap,
    rows,
    spin,
)
from tests.support.stored_recordings import there_and_back

FIRST, SECOND = "192.168.1.201", "192.168.1.202"


def swapped(packets: list[bytes]) -> list[bytes]:
    """Every seventh pair is swapped."""
    order = list(packets)
    order[:-1:7], order[1::7] = order[1::7], order[:-1:7]
    return order


def sent(payload: bytes, sender: str, port: int = 2368) -> bytes:
    return ethernet(ipv4(udp(payload, port), sender))


def both(first: list[bytes], second: list[bytes]) -> list[bytes]:
    """Frames of two sensors by turns, not quite regularly."""
    frames = []
    for number, (one, other) in enumerate(zip(first, second, strict=True)):
        frames += [other, one] if number % 5 == 3 else [one, other]
    return frames


def turns_of(packets: NDArray[np.uint8]) -> list[NDArray[np.uint16]]:
    return [turn_of(*part).ranges for part in split_turns(packets)]


def same(turns: list[NDArray[np.uint16]], others: list[NDArray[np.uint16]]) -> bool:
    return len(turns) == len(others) and all(map(np.array_equal, turns, others))


@pytest.mark.parametrize(
    ("product", "mode", "count"), [(VLP16, STRONGEST, 120), (VLP16, DUAL, 90), (HDL64E, DUAL, 120)]
)
def test_packets_out_of_order_cost_little_and_form_the_same_turns(
    product: int, mode: int, count: int, tmp_path: Path
) -> None:
    packets = spin(product, mode, packets=count)
    plain = there_and_back(tmp_path, pcap(rows(packets)))
    account = there_and_back(tmp_path, pcap(swapped(rows(packets))))
    assert account.compressed < 1.02 * plain.compressed
    turns = [turn.ranges for turn in decode_turns((tmp_path / "small.puck").read_bytes())]
    assert same(turns, turns_of(packets))


def test_packets_in_order_have_no_record_of_an_order(tmp_path: Path) -> None:
    account = there_and_back(tmp_path, pcap(rows(spin(packets=50))))
    assert set(account.parts) == {"layout", "turn", "gaps", "end"}


@pytest.mark.parametrize(
    "rows_of",
    [
        lambda count: np.arange(count)[::-1],
        lambda count: np.random.default_rng(1).permutation(count),
        lambda count: np.r_[20:count, 0:20],
        lambda count: np.repeat(np.arange(count), 2),
    ],
    ids=["reversed", "shuffled", "moved", "twice"],
)
def test_any_order_comes_back(rows_of: object, tmp_path: Path) -> None:
    assert callable(rows_of)
    packets = spin(packets=60)[rows_of(60)]
    assert there_and_back(tmp_path, pcap(rows(packets))).packets == len(packets)


def test_two_sensors_are_compressed_apart(tmp_path: Path) -> None:
    one, other = spin(packets=120), spin(packets=120, seed=1)
    frames = [[sent(row, FIRST) for row in rows(one)], [sent(row, SECOND) for row in rows(other)]]
    alone = [there_and_back(tmp_path, pcap_of_frames(*each)) for each in frames]
    account = there_and_back(tmp_path, pcap_of_frames(*both(*frames)))
    assert account.packets == 240
    assert account.turns == sum(each.turns for each in alone)
    assert account.compressed < 1.02 * sum(each.compressed for each in alone)
    stream = (tmp_path / "small.puck").read_bytes()
    turns = [turn.ranges for turn in decode_turns(stream)]
    assert same(turns, turns_of(one) + turns_of(other))
    assert same([turn.ranges for turn in read_turns(BytesIO(stream))], turns)


def test_sensors_are_told_apart_by_port_address_or_product(tmp_path: Path) -> None:
    one, other, other_kind = spin(packets=40), spin(packets=40, seed=1), spin(HDL32E, packets=40)
    frames = [
        ([sent(row, FIRST) for row in rows(one)], [sent(row, FIRST, 2369) for row in rows(other)]),
        (
            [ethernet(ipv6(udp(row)), 0x86DD) for row in rows(one)],
            [ethernet(ipv6(udp(row), "fe80::2"), 0x86DD) for row in rows(other)],
        ),
        (rows(one), rows(other_kind)),  # without headers
    ]
    for (first, second), packets in zip(frames, (other, other, other_kind), strict=True):
        there_and_back(tmp_path, pcap_of_frames(*both(first, second)))
        decoded = decode_turns((tmp_path / "small.puck").read_bytes())
        assert same([turn.ranges for turn in decoded], turns_of(one) + turns_of(packets))


def test_parts_of_a_long_recording_go_on_with_each_sensors_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """LZMA compresses parts in which nothing is seen, since their turns would be too small."""
    monkeypatch.setattr("puck.recording._WINDOW", 50_000)
    monkeypatch.setattr("puck.records._FEW_RANGES", 20_000)
    monkeypatch.setattr("puck.records._RANGES_PER_BYTE", 1)
    empty = rows(nothing_seen(100))
    frames = [
        [
            sent(row, sender)
            for row in swapped([*rows(spin(packets=150, seed=seed)), *empty, *empty])
        ]
        for seed, sender in enumerate((FIRST, SECOND))
    ]
    account = there_and_back(tmp_path, pcap_of_frames(*both(*frames)))
    assert 300 <= account.packets < 700


def test_turns_of_several_sensors_are_decoded_from_their_key_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("puck.recording._WINDOW", 100_000)
    frames = [
        [sent(row, sender) for row in rows(spin(packets=200, seed=seed))]
        for seed, sender in enumerate((FIRST, SECOND))
    ]
    there_and_back(tmp_path, pcap_of_frames(*both(*frames)), CodingOptions(key_every=3))
    stream = (tmp_path / "small.puck").read_bytes()
    turns = [turn.ranges for turn in decode_turns(stream)]
    assert len(turns) > 12
    for first in range(len(turns)):
        for end in (first + 1, first + 2, None):
            part = [turn.ranges for turn in decode_turns(stream, first, end)]
            assert same(part, turns[first:end])


@pytest.mark.parametrize("kind", [RecordKind.SENSOR, RecordKind.ORDER])
def test_damaged_records_end_in_one_error(kind: RecordKind, tmp_path: Path) -> None:
    frames = [
        [sent(row, sender) for row in rows(spin(packets=40, seed=seed))]
        for seed, sender in enumerate((FIRST, SECOND))
    ]
    there_and_back(tmp_path, pcap_of_frames(*both(*frames)))
    whole = [*read_records(BytesIO((tmp_path / "small.puck").read_bytes()))]
    (place,) = (k for k, record in enumerate(whole) if record.kind == kind)
    for body in (b"", b"\0", b"\x0f", b"\xff", whole[place].body[:-1]):
        records = [*whole[:place], Record(kind, body), *whole[place + 1 : -1]]
        (tmp_path / "bad.puck").write_bytes(join_records(records))
        with pytest.raises(InputError, match=r"bad\.puck"):
            decompress(tmp_path / "bad.puck", tmp_path / "out")
    (tmp_path / "bad.puck").write_bytes(join_records([*whole[:place], *whole[place + 1 : -1]]))
    with pytest.raises(InputError, match=r"bad\.puck"):
        decompress(tmp_path / "bad.puck", tmp_path / "out")


@pytest.mark.parametrize("leap_us", [-400_000, -50_000, -24_900, 100_000])
def test_a_leap_of_the_clock_costs_little_and_mixes_no_turns(leap_us: int, tmp_path: Path) -> None:
    """Two turns of these packets take 49.8 ms."""
    packets = spin(packets=120)
    plain = there_and_back(tmp_path, pcap(rows(packets)))
    table = packets.copy().view(PACKET)[:, 0]
    after = table["time"][60:].astype(np.int64) + leap_us
    table["time"][60:] = after % 3_600_000_000
    leapt = table.view(np.uint8).reshape(len(packets), -1)
    account = there_and_back(tmp_path, pcap(rows(leapt)))
    assert "order" not in account.parts
    assert account.compressed < 1.01 * plain.compressed
    turns = [turn.ranges for turn in decode_turns((tmp_path / "small.puck").read_bytes())]
    assert same(turns, turns_of(packets))


def test_a_sensor_that_is_alone_in_a_part_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other sensor stops early, so that later parts have packets of the second only."""
    monkeypatch.setattr("puck.recording._WINDOW", 50_000)
    one, other = rows(spin(packets=20)), rows(spin(packets=150, seed=1))
    frames = both([sent(row, FIRST) for row in one], [sent(row, SECOND) for row in other[:20]])
    frames += [sent(row, SECOND) for row in other[20:]]
    assert there_and_back(tmp_path, pcap_of_frames(*frames)).packets == 170


def test_many_sensors_share_numbers_with_those_of_their_format(tmp_path: Path) -> None:
    packets = rows(spin(packets=60))
    frames = [sent(row, FIRST, 2000 + number % 20) for number, row in enumerate(packets)]
    assert there_and_back(tmp_path, pcap_of_frames(*frames)).packets == 60
