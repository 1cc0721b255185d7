"""Recordings as streams: every byte comes back, whatever is in them."""

from __future__ import annotations

import json
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from puckbench.cli import main
from puckbench.codecs.puck import recording
from puckbench.codecs.puck.recording import Account, compress, decompress
from puckbench.codecs.puck.stream import decode
from puckbench.codecs.puck.turns import Settings
from puckbench.core.errors import InputError
from puckbench.lidar.recordings.packet_turns import find_packets, split_turns, turn_of
from tests.support.spinning import DUAL, HDL32E, STRONGEST, VLP16, pcap, rows, spin

POSITION = b"$GPRMC,223123,A,3707.8178,N,12139.2690,W,000.0,182.4,160516,013.7,E,D*05\r\n"


def there_and_back(folder: Path, data: bytes, settings: Settings | None = None) -> Account:
    """Compress and decompress bytes; what was in them."""
    (folder / "recording").write_bytes(data)
    account = compress(folder / "recording", folder / "small.puck", settings)
    decompress(folder / "small.puck", folder / "back")
    assert (folder / "back").read_bytes() == data
    assert account.compressed == (folder / "small.puck").stat().st_size
    return account


def recorded() -> list[bytes]:
    return rows(spin(packets=50))


@pytest.mark.parametrize("effort", ["fast", "normal", "thorough"])
@pytest.mark.parametrize("product", [VLP16, HDL32E])
@pytest.mark.parametrize("mode", [STRONGEST, DUAL])
def test_a_packet_capture_comes_back(tmp_path: Path, product: int, mode: int, effort: str) -> None:
    data = pcap(rows(spin(product, mode, packets=50)))
    account = there_and_back(tmp_path, data, Settings(effort=effort))
    assert account.packets == 50
    assert account.turns >= 2
    assert account.compressed < 0.5 * len(data)


def odd_packets() -> dict[str, bytes]:
    packets = recorded()
    both = [*packets[:9], *rows(spin(HDL32E, packets=9)), *rows(spin(VLP16, DUAL, packets=9))]
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
    monkeypatch.setattr("puckbench.codecs.puck.recording._WINDOW", 9001)
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
    assert there_and_back(tmp_path, data).packets == 49
    monkeypatch.setattr("puckbench.codecs.puck.recording._WINDOW", 9001)
    assert there_and_back(tmp_path, data).packets == 49


def test_headers_cost_few_bytes(tmp_path: Path) -> None:
    account = there_and_back(tmp_path, pcap(recorded()))
    assert account.parts["gaps"] < 50 * 6


def test_turns_of_a_compressed_recording_can_be_had(tmp_path: Path) -> None:
    there_and_back(tmp_path, pcap(recorded()), Settings(key_every=2))
    turns = [turn_of(*part) for part in split_turns(spin(packets=50))]
    found = decode((tmp_path / "small.puck").read_bytes(), 2, 3)
    assert len(found) == 1
    assert np.array_equal(found[0].ranges, turns[2].ranges)
    assert np.array_equal(found[0].reflectivities, turns[2].reflectivities)


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
    from puckbench.codecs.puck.stream import encode

    kind, payloads = next(split_turns(spin(packets=9)))
    stream = encode([turn_of(kind, payloads)], kind.layout, Settings(times=False))
    (tmp_path / "turns.puck").write_bytes(stream)
    with pytest.raises(InputError, match=r"turns\.puck"):
        decompress(tmp_path / "turns.puck", tmp_path / "out.pcap")


def test_a_recording_is_not_compressed_with_loss(tmp_path: Path) -> None:
    (tmp_path / "a.pcap").write_bytes(pcap(recorded()[:2]))
    with pytest.raises(InputError, match="without loss"):
        compress(tmp_path / "a.pcap", tmp_path / "a.puck", Settings(step=2))


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = pcap(recorded())
    (tmp_path / "a.pcap").write_bytes(data)
    names = [str(tmp_path / name) for name in ("a.pcap", "a.puck", "b.pcap")]
    assert main(["compress", *names[:2], "--effort", "fast", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["packets"] == 50
    assert answer["compressed_bytes"] == (tmp_path / "a.puck").stat().st_size
    assert main(["decompress", *names[1:], "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == answer
    assert (tmp_path / "b.pcap").read_bytes() == data


def told(asked: list[str], capsys: pytest.CaptureFixture[str]) -> list[str]:
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
        lines = told([command, *asked], capsys)
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
        assert line.startswith("puckbench: ")
        assert str(path) in line
        assert line.count("\n") == 1
        assert not (tmp_path / "out").exists()


def test_a_recording_of_turns_without_information_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    account = there_and_back(tmp_path, pcap(recorded()))
    assert account.ranges == account.packets * 384 + account.turns * 256
    monkeypatch.setattr(recording, "_MANY_RANGES", account.ranges - account.compressed - 1)
    monkeypatch.setattr(recording, "_RANGES_PER_BYTE", 1)
    refusal = f"{account.ranges} ranges in {account.compressed} bytes"
    with pytest.raises(InputError, match=refusal):
        decompress(tmp_path / "small.puck", tmp_path / "again")
    with pytest.raises(InputError, match=refusal):
        compress(tmp_path / "recording", tmp_path / "again")
    assert not (tmp_path / "again").exists()
