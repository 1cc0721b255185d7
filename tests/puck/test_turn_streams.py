"""Streams that are written and read turn by turn."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.turns import Turn
from puck import (
    CodingOptions,
    Writer,
    compress,
    decode_turns,
    encode_turns,
    packet_kind,
    packets_of,
    read_turns,
)
from puck.recordings.packet_turns import split_turns, turn_of
from puck.turn_packets import index_turns
from tests.support.spinning import DUAL, HDL32E, STRONGEST, VLP16, pcap, rows, spin

KIND = packet_kind(VLP16, STRONGEST)


def recorded_turns(packets: int = 90) -> list[Turn]:
    return [turn_of(KIND, part) for _, part in split_turns(spin(packets=packets))]


def assert_same(turns: list[Turn], expected: list[Turn]) -> None:
    assert len(turns) == len(expected)
    for turn, other in zip(turns, expected, strict=True):
        for name in ("ranges", "azimuths", "times", "reflectivities"):
            assert np.array_equal(getattr(turn, name), getattr(other, name))


def test_a_writer_gives_the_stream_of_all_turns() -> None:
    turns, stream = recorded_turns(), BytesIO()
    with Writer(stream, KIND.layout) as writer:
        sizes = [writer.add(turn) for turn in turns]
    assert stream.getvalue() == encode_turns(turns, KIND.layout)
    assert sum(sizes) < len(stream.getvalue())
    assert_same(list(read_turns(BytesIO(stream.getvalue()))), turns)


def test_a_turn_is_decoded_before_the_next_is_written() -> None:
    turns, (incoming, outgoing) = recorded_turns(), os.pipe()
    is_read, read = threading.Semaphore(0), list[Turn]()

    def receive() -> None:
        with os.fdopen(incoming, "rb") as stream:
            for turn in read_turns(stream):
                read.append(turn)
                is_read.release()

    receiver = threading.Thread(target=receive)
    receiver.start()
    with os.fdopen(outgoing, "wb") as stream, Writer(stream, KIND.layout) as writer:
        for number, turn in enumerate(turns, 1):
            writer.add(turn)
            assert is_read.acquire(timeout=60)
            assert len(read) == number
    receiver.join()
    assert_same(read, turns)


def test_a_stream_without_an_end_is_truncated() -> None:
    stream = BytesIO()

    def fail() -> None:
        with Writer(stream, KIND.layout) as writer:
            writer.add(recorded_turns()[0])
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    read = read_turns(BytesIO(stream.getvalue()))
    next(read)
    with pytest.raises(InputError, match="truncated"):
        next(read)


@pytest.mark.parametrize("first", [0, 1, 2, 3, 4, 9])
def test_some_turns_of_a_file_are_those_of_its_bytes(tmp_path: Path, first: int) -> None:
    (tmp_path / "a").write_bytes(pcap(rows(spin(packets=90))))
    compress(tmp_path / "a", tmp_path / "a.puck", CodingOptions(effort="fast", key_every=2))
    turns = recorded_turns()
    with (tmp_path / "a.puck").open("rb") as file:
        assert_same(decode_turns(file, first, first + 2), turns[first : first + 2])


def test_only_the_turns_that_are_needed_are_read(tmp_path: Path) -> None:
    """The rest of the file may be damaged."""
    turns = recorded_turns()
    options = CodingOptions(effort="fast", key_every=2)
    stream = bytearray(encode_turns(turns, KIND.layout, options))
    sizes = [len(encode_turns(turns[:k], KIND.layout, options)) - 2 for k in range(len(turns) + 1)]
    stream[sizes[1] - 20] ^= 1
    stream[sizes[5] - 20] ^= 1
    assert_same(decode_turns(bytes(stream), 2, 4), turns[2:4])
    for first, end in ((0, 1), (4, 5)):
        with pytest.raises(InputError, match="damaged"):
            decode_turns(bytes(stream), first, end)


@pytest.mark.parametrize("is_compressed", [False, True])
def test_packets_of_some_turns_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_compressed: bool
) -> None:
    monkeypatch.setattr("puck.recording._WINDOW", 60_000)
    packets, path = spin(packets=90), tmp_path / "a"
    parts = [part for _, part in split_turns(packets)]
    path.write_bytes(pcap(rows(packets)))
    if is_compressed:
        compress(path, tmp_path / "b", CodingOptions(effort="fast", key_every=2))
        path = tmp_path / "b"
    index = index_turns(path)
    assert index is not None
    assert (index.kind, index.count) == (KIND, len(parts))
    assert all(map(np.array_equal, index.packets(3, 5), parts[3:5]))
    assert len(index.packets(len(parts) - 1, 99)) == 1
    assert not index.packets(len(parts), 99)


@pytest.mark.parametrize("is_compressed", [False, True])
@pytest.mark.parametrize("what", ["two sensors", "turns of several lengths", "no capture"])
def test_turns_that_may_be_no_revolutions_are_not_found(
    tmp_path: Path, what: str, is_compressed: bool
) -> None:
    packets = rows(spin(packets=90))
    data = {
        "two sensors": pcap([*packets, *rows(spin(HDL32E, DUAL, packets=40))]),
        "turns of several lengths": pcap(packets[:40] + packets[50:]),
        "no capture": b"".join(packets),
    }
    path = tmp_path / "a"
    path.write_bytes(data[what])
    if is_compressed:
        compress(path, tmp_path / "a.puck", CodingOptions(effort="fast"))
        path = tmp_path / "a.puck"
    assert index_turns(path) is None


def test_packets_come_back_from_turns_one_after_another() -> None:
    packets, stream = spin(packets=40), BytesIO()
    with Writer(stream, KIND.layout) as writer:
        for _, part in split_turns(packets):
            writer.add(turn_of(KIND, part))
    back = [packets_of(KIND, turn) for turn in read_turns(BytesIO(stream.getvalue()))]
    assert np.array_equal(np.concatenate(back), packets)


def test_memory_does_not_grow_with_the_number_of_turns(tmp_path: Path) -> None:
    """A million packets would have to take less than 300 MB; this is a fiftieth of both.

    What the compiler of the loops takes does not count.
    """
    command = [sys.executable, "-c", MEASURE, str(tmp_path / "live.puck"), "20000"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    written, read, writing_mib, reading_mib = map(float, done.stdout.split())
    assert written == read > 20_000
    assert max(writing_mib, reading_mib) < 6


ROOT = Path(__file__).parents[2]
MEASURE = """
import resource, sys
from dataclasses import replace
import numpy as np
from puck import CodingOptions, Writer, packet_kind, read_turns
from puck.recordings.packet_turns import split_turns, turn_of
from tests.support.spinning import spin

def resident_mib():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 2**20

path, most = sys.argv[1], int(sys.argv[2])
kind, packets = packet_kind(0x22, 0x37), spin(packets=400, rise=40)
turns = [turn_of(kind, part) for _, part in split_turns(packets)]
written = read = repetition = 0
few = 5000  # packets, of some turns after a second key turn
writing, reading = [], []
with open(path, "w+b") as file, Writer(file, kind.layout, CodingOptions(effort="fast")) as writer:
    while written <= most:
        for turn in turns:
            times = (turn.times.astype(np.int64) + 1327 * 400 * repetition) % 3_600_000_000
            writer.add(replace(turn, times=times.astype(np.uint32)))
            written += len(times)
            if written > few:
                writing.append(resident_mib())
        repetition += 1
with open(path, "rb") as file:
    for turn in read_turns(file):
        read += len(turn.times)
        if read > few:
            reading.append(resident_mib())
print(written, read, max(writing) - writing[0], max(reading) - reading[0])
"""
