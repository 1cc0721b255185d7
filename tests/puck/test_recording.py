"""Recordings as streams: every byte comes back, whatever is in them."""

from __future__ import annotations

import lzma
import sqlite3
import sys
import zlib
from collections.abc import Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from pointkit.coding.byte_io import base_128
from pointkit.errors import InputError
from puck import (
    CodingOptions,
    compress,
    decode_turns,
    decompress,
    encode_turns,
    packet_kinds,
    recording,
    records,
)
from puck.__main__ import main
from puck.gaps import compress_bytes, encode_gaps
from puck.recordings.packet_turns import find_packets, split_turns, turn_of
from puck.records import Record, RecordKind, join_records, start
from puck.sqlite_payloads import PageOrder, Payload, encode_payloads
from tests.support.spinning import (
    DUAL,
    HDL32E,
    HDL64E,
    STRONGEST,
    VLP16,
    VLP32C,
    VLS128,
    nothing_seen,
    pcap,
    rows,
    spin,
)
from tests.support.stored_recordings import there_and_back

POSITION = b"$GPRMC,223123,A,3707.8178,N,12139.2690,W,000.0,182.4,160516,013.7,E,D*05\r\n"


def recorded() -> list[bytes]:
    return rows(spin(packets=50))


@pytest.mark.parametrize("effort", ["fast", "normal", "thorough"])
@pytest.mark.parametrize("product", [VLP16, HDL32E, VLP32C, HDL64E, VLS128])
@pytest.mark.parametrize("mode", [STRONGEST, DUAL])
def test_a_packet_capture_comes_back(tmp_path: Path, product: int, mode: int, effort: str) -> None:
    packets = {(HDL64E, DUAL): 90, (VLS128, STRONGEST): 90, (VLS128, DUAL): 270}
    count = packets.get((product, mode), 50)
    data = pcap(rows(spin(product, mode, packets=count)))
    account = there_and_back(tmp_path, data, CodingOptions(effort=effort))
    assert account.packets == count
    assert account.turns >= 2
    assert account.compressed < 0.5 * len(data)
    assert account.compressed < 0.95 * len(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))


def test_blocks_of_an_alpha_prime_without_lasers_come_back(tmp_path: Path) -> None:
    packets = spin(VLS128, DUAL, packets=30)
    packets[:, 800:1200] = np.random.default_rng(0).integers(0, 256, 400)
    assert there_and_back(tmp_path, pcap(rows(packets))).packets == 30


def odd_packets() -> dict[str, bytes]:
    packets = recorded()
    both = [*packets[:9], *rows(spin(HDL32E, packets=9)), *rows(spin(VLP16, DUAL, packets=9))]
    both += [*rows(spin(HDL64E, packets=5)), *rows(spin(HDL64E, DUAL, packets=5))]
    damaged = [bytearray(packet) for packet in packets]
    damaged[5][0] = 0  # a flag
    damaged[6][2:4] = b"\xff\xff"  # an azimuth beyond 360 degrees
    damaged[7][-1] = 0xA1  # another product
    damaged[8][-2] = 0x99  # another return mode
    dual = [bytearray(packet) for packet in rows(spin(VLP16, DUAL, packets=9))]
    dual[3][102] ^= 1  # the azimuth of a pair's second block
    positions = [POSITION.ljust(512, b"\0"), *packets[:20], POSITION.ljust(512, b"\0")]
    return {
        "position packets": pcap(positions),
        "several sensors": pcap(both),
        "damaged packets": pcap([*map(bytes, damaged), *map(bytes, dual)]),
        "cut off": pcap(packets)[:-700],
        "cut off in a header": pcap(packets)[: -1206 - 20],
        "a gap": pcap(packets[:10] + packets[30:]),
        "time running backwards": pcap(packets[::-1]),
        "one packet": pcap(packets[:1]),
        "one packet of each turn": pcap(packets[::18]),
        "packets alone": b"".join(packets),
        "a packet within a packet": packets[0][:600] + packets[1] + packets[0][600:],
        "no packet": b"a text\n" * 100,
        "other packets only": pcap([b"\x01\x02" * 500] * 20),
        "nothing": b"",
        "noise": np.random.default_rng(0).bytes(5000),
    }


@pytest.mark.parametrize("name", odd_packets())
def test_whatever_is_in_a_recording_comes_back(tmp_path: Path, name: str) -> None:
    account = there_and_back(tmp_path, odd_packets()[name])
    assert (account.packets > 0) == (
        name not in {"no packet", "other packets only", "nothing", "noise"}
    )


def test_windows_of_a_long_recording_cut_no_packet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("puck.recording._WINDOW", 9001)
    account = there_and_back(tmp_path, pcap(recorded()))
    assert account.packets == 50


def test_packets_on_the_pages_of_a_bag_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(sqlite3.connect(tmp_path / "bag.db3")) as bag, bag:
        bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, data BLOB)")
        bag.execute("INSERT INTO messages(data) VALUES (?)", (b"".join(recorded()),))
    data = (tmp_path / "bag.db3").read_bytes()
    assert len(find_packets(np.frombuffer(data, np.uint8))) < 40
    # The first packet begins on another page than the one before the others'.
    assert there_and_back(tmp_path, data).packets == 50
    monkeypatch.setattr("puck.recording._WINDOW", 9001)
    assert there_and_back(tmp_path, data).packets == 50


def test_headers_cost_few_bytes(tmp_path: Path) -> None:
    account = there_and_back(tmp_path, pcap(recorded()))
    assert account.parts["gaps"] < 50 * 6


def test_turns_of_a_compressed_recording_can_be_had(tmp_path: Path) -> None:
    there_and_back(tmp_path, pcap(recorded()), CodingOptions(key_every=2))
    turns = [turn_of(*part) for part in split_turns(spin(packets=50))]
    decoded = decode_turns((tmp_path / "small.puck").read_bytes(), 2, 3)
    assert len(decoded) == 1
    assert np.array_equal(decoded[0].ranges, turns[2].ranges)
    assert np.array_equal(decoded[0].reflectivities, turns[2].reflectivities)


def test_damaged_files_end_in_one_error_and_leave_nothing(tmp_path: Path) -> None:
    there_and_back(tmp_path, pcap(recorded()[:20]))
    whole = (tmp_path / "small.puck").read_bytes()
    random, out = np.random.default_rng(1), tmp_path / "out.pcap"
    for number in range(150):
        changed = bytearray(whole)
        if number % 3 == 0:
            changed = changed[: random.integers(len(whole))]
        else:
            changed[random.integers(len(whole))] ^= 1 << random.integers(8)
        (tmp_path / "bad.puck").write_bytes(changed)
        with pytest.raises(InputError, match=r"bad\.puck"):
            decompress(tmp_path / "bad.puck", out)
        assert not out.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "back", "bad.puck", "recording", "small.puck",
    ]  # fmt: skip


def test_turns_without_packets_are_no_recording(tmp_path: Path) -> None:

    kind, payloads = next(split_turns(spin(packets=9)))
    turns = encode_turns([turn_of(kind, payloads)], kind.layout, CodingOptions(times=False))
    (tmp_path / "turns.puck").write_bytes(turns)
    with pytest.raises(InputError, match=r"turns\.puck"):
        decompress(tmp_path / "turns.puck", tmp_path / "out.pcap")


def test_a_recording_is_not_compressed_with_loss(tmp_path: Path) -> None:
    (tmp_path / "a.pcap").write_bytes(pcap(recorded()[:2]))
    with pytest.raises(InputError, match="without loss"):
        compress(tmp_path / "a.pcap", tmp_path / "a.puck", CodingOptions(step=2))


def progress_lines(asked: list[str], capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Lines of progress at a terminal, of which only the last is ended."""
    assert main(asked) == 0
    written = capsys.readouterr().err
    assert written.endswith("\n")
    first, *lines = written.removesuffix("\n").split("\r")
    assert first == ""
    assert "\n" not in "".join(lines)
    return lines


def test_progress_is_told_turn_by_turn_and_its_line_is_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    data = pcap(recorded())
    (tmp_path / "a.pcap").write_bytes(data)
    names = [str(tmp_path / name) for name in ("a.pcap", "a.puck", "b.pcap")]
    turns = len(list(split_turns(spin(packets=50))))
    for command, asked in (("compress", names[:2]), ("decompress", names[1:])):
        lines = progress_lines([command, *asked], capsys)
        size = Path(asked[0]).stat().st_size
        assert len(lines) >= turns + 1
        done = [int(line.split()[1].replace(",", "")) for line in lines]
        assert done == sorted(done)
        assert done[0] < 0.5 * size
        assert done[-1] == size
        assert done.count(size) == 1


@pytest.mark.parametrize("command", ["compress", "decompress"])
def test_a_file_is_not_written_over_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    path, data = tmp_path / "a", pcap(recorded())
    path.write_bytes(data)
    if command == "decompress":
        compress(path, tmp_path / "b")
        data = (tmp_path / "b").read_bytes()
        path.write_bytes(data)
    (tmp_path / "link").symlink_to(path)
    for out in (path, tmp_path / "link"):
        assert main([command, str(path), str(out)]) == 2
        assert "is the file that is read" in capsys.readouterr().err
        assert path.read_bytes() == data


@pytest.mark.parametrize("command", ["compress", "decompress"])
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    (tmp_path / "text").write_text("not a stream")
    bad = [tmp_path / "missing", tmp_path] + [tmp_path / "text"] * (command == "decompress")
    for path in bad:
        assert main([command, str(path), str(tmp_path / "out")]) == 2
        line = capsys.readouterr().err
        assert line.startswith("puck: ")
        assert str(path) in line
        assert line.count("\n") == 1
        assert not (tmp_path / "out").exists()


def covered(packets: int) -> list[bytes]:
    """Packets of a sensor that sees nothing: some hundred ranges a byte."""
    return rows(nothing_seen(packets))


def tight_limits(
    monkeypatch: pytest.MonkeyPatch, *, recording_bytes: int, per_byte: int, ranges: int
) -> None:
    """Let streams hold so much, and windows of the encoder be short."""
    monkeypatch.setattr(recording, "_WINDOW", 9001)
    monkeypatch.setattr(recording, "_MANY_BYTES", recording_bytes)
    monkeypatch.setattr(recording, "_BYTES_PER_BYTE", per_byte)
    for name, number in (("_FEW_RANGES", ranges), ("_RANGES_PER_BYTE", 4), ("_SMALL_BYTES", 0)):
        monkeypatch.setattr(records, name, number)


@pytest.mark.parametrize("seed", range(12))
def test_what_the_encoder_writes_the_decoder_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Whatever the limits: what would be smaller than they allow is written larger."""
    random = np.random.default_rng(seed)
    few, per_byte, ranges = random.integers([0, 1, 0], [40_000, 30, 30_000]).tolist()
    tight_limits(monkeypatch, recording_bytes=9017 + few, per_byte=per_byte, ranges=ranges)
    parts = [covered(60), recorded(), [b"", bytes(5000)] * 9, [random.bytes(700)] * 3]
    chosen = [parts[k] for k in random.permutation(len(parts))[: random.integers(1, 5)]]
    data = pcap([packet for part in chosen for packet in part])
    account = there_and_back(tmp_path, data)
    assert len(data) <= 9017 + few + per_byte * account.compressed
    assert account.ranges <= records.most_ranges(account.compressed)


def test_pages_of_nothing_come_back_within_tight_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tight_limits(monkeypatch, recording_bytes=9100, per_byte=3, ranges=0)
    with closing(sqlite3.connect(tmp_path / "bag.db3")) as bag, bag:
        bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, data BLOB)")
        bag.execute("INSERT INTO messages(data) VALUES (zeroblob(200000))")
    there_and_back(tmp_path, (tmp_path / "bag.db3").read_bytes())


def bomb(folder: Path, data: bytes, monkeypatch: pytest.MonkeyPatch, name: str) -> Path:
    """A stream of an encoder that knows no limits."""
    (folder / "recording").write_bytes(data)
    with monkeypatch.context() as patches:
        patches.setattr(recording, "_fits", lambda *_: True)
        compress(folder / "recording", folder / name)
    return folder / name


def test_a_recording_of_turns_without_information_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packet_kinds.TurnDecoder, "decode", None)
    packets = covered(18)
    small = bomb(tmp_path, pcap(packets * 1500), monkeypatch, "small.puck")
    assert small.stat().st_size < 50_000
    with pytest.raises(InputError, match=r"small\.puck: \d+ ranges in \d+ bytes: more than they"):
        decompress(small, tmp_path / "again")
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize("is_sqlite", [False, True])
def test_a_recording_of_too_many_bytes_is_refused_and_can_be_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_sqlite: bool,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    data = bytes(60 << 20)
    if is_sqlite:
        data = b"SQLite format 3\0\2\0" + data[18:]  # pages of 512 bytes
    small = bomb(tmp_path, data, monkeypatch, "small.puck")
    assert small.stat().st_size < 20_000
    back = tmp_path / "back"
    with pytest.raises(InputError, match=r"small\.puck: \d+ bytes in \d+ bytes.*--trusted"):
        decompress(small, back)
    assert not back.exists()
    assert main(["decompress", str(small), str(back)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["decompress", str(small), str(back), "--trusted"]) == 0
    assert back.read_bytes() == data
    compress(back, small)  # by the encoder as it is
    decompress(small, back)


def test_links_of_pages_stand_once(tmp_path: Path) -> None:
    """Each record of a few bytes would unpack to 64 MiB."""
    links = Record(RecordKind.PAGES, base_128(512) + compress_bytes(bytes(4)))
    (tmp_path / "links.puck").write_bytes(join_records([links, links]))
    with pytest.raises(InputError, match=r"links\.puck: the stream is damaged"):
        decompress(tmp_path / "links.puck", tmp_path / "out")


def test_turns_of_a_stream_are_refused_before_they_are_decoded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    small = bomb(tmp_path, pcap(covered(400)), monkeypatch, "small.puck").read_bytes()
    monkeypatch.setattr(records, "_FEW_RANGES", 150 * 384 + 1024)
    monkeypatch.setattr(records, "_RANGES_PER_BYTE", 0)
    assert len(decode_turns(small, 0, 1)) == 1
    with pytest.raises(InputError, match="ranges in"):
        decode_turns(small)


def pages_bomb(payloads: list[Payload], pages: int, times: int = 1) -> list[Record]:
    """Records that state rows of an SQLite file of pages of 512 bytes, and hold 30 bytes."""
    links = base_128(512) + compress_bytes(bytes(4 * pages))
    record = Record(RecordKind.PAYLOADS, encode_payloads(payloads))
    gaps = Record(RecordKind.GAPS, base_128(0) + encode_gaps([b"a" * 30]))
    return [Record(RecordKind.PAGES, links), *[record] * times, gaps]


def end_of(data: bytes) -> Record:
    body = len(data).to_bytes(8, "little") + zlib.crc32(data).to_bytes(4, "little")
    return Record(RecordKind.END, body)


def test_pages_that_do_not_come_are_not_made(tmp_path: Path) -> None:
    """The first row begins on the last page, and no other page is written."""
    for pages, fault in ((2000, "the stream is damaged"), (200_000, r"\d+ bytes in \d+ bytes")):
        stated = pages_bomb([Payload(pages - 1, 100, 600, 0)], pages)
        end = end_of(bytes((pages - 1) * 512 + 100) + b"a" * 30)
        data = b"".join([start(), *(each.packed() for each in (*stated, end))])
        (tmp_path / "a.puck").write_bytes(data)
        with pytest.raises(InputError, match=fault):
            decompress(tmp_path / "a.puck", tmp_path / "out")
        out = BytesIO()
        with pytest.raises(InputError, match="the stream is damaged"):
            decompress(BytesIO(data), out)
        assert not (tmp_path / "out").exists()


def test_rows_of_pages_are_few_and_stand_once(monkeypatch: pytest.MonkeyPatch) -> None:
    payloads = [Payload(number, 100, 600, number + 1) for number in range(0, 1000, 2)]
    many = join_records(pages_bomb(payloads, 1000))
    with monkeypatch.context() as patches:
        patches.setattr("puck.sqlite_payloads._FEW_PARTS", 400)
        patches.setattr("puck.sqlite_payloads._PARTS_PER_BYTE", 0)
        patches.setattr("puck.sqlite_payloads.PageOrder", None)
        with pytest.raises(InputError, match="the stream is damaged"):
            decompress(BytesIO(many), BytesIO())
    twice = join_records(pages_bomb(payloads, 1000, times=2))
    parts, made = PageOrder.parts, []
    monkeypatch.setattr(PageOrder, "parts", lambda *given: made.append(1) or parts(*given))
    with pytest.raises(InputError, match="the stream is damaged"):
        decompress(BytesIO(twice), BytesIO())
    assert len(made) == 1


def test_pages_are_visited_a_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every row's chain goes through all pages, of which the last leads out of the file."""
    count, visits = 3000, []
    links = np.roll(np.arange(count), -7) + 1
    links[-1] = count + 1
    order = PageOrder(512, links.astype(">u4").view(np.uint8).reshape(-1, 4))
    chain = PageOrder._chain

    def counted(self: PageOrder, payload: Payload) -> Iterator[object]:
        for run in chain(self, payload):
            visits.append(run)
            yield run

    monkeypatch.setattr(PageOrder, "_chain", counted)
    order.usable([Payload(0, 100, count * 500, first) for first in range(count)])
    assert count < len(visits) < 6 * count
