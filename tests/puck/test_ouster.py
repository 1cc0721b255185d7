"""Recordings of Ouster sensors as streams: every byte comes back, and pixels are modelled."""

from __future__ import annotations

import json
import lzma
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puck import CodingOptions, compress, decode_turns, decompress
from puck.recording import RecordingSummary
from puck.recordings.ouster import PROFILES, OusterSensor, ouster_turns, read_sensor
from puck.recordings.ouster_packets import OusterKind
from tests.support.ouster import SERIAL, TICKS, capture, metadata

WHOLE = 1 << 16


def sensor_of(folder: Path, profile: str) -> OusterSensor:
    path = folder / "drive.json"
    path.write_text(json.dumps(metadata(profile)))
    return read_sensor(path)


def sent(
    sensor: OusterSensor, turns: int = 2, seed: int = 0, *, is_odd: bool = False
) -> list[bytes]:
    """Packets of smooth images in every field; odd ones have other bits set where none are."""
    random, kind = np.random.default_rng(0), OusterKind.of(sensor)
    count, lasers = sensor.columns, sensor.lasers
    packets = np.zeros((turns, count // 16), kind.packet)
    columns = np.zeros((turns, count), kind.packet["columns"].base)
    columns["column"] = np.arange(count)
    since = 97_650 * np.arange(turns * count) + 10 * random.integers(0, 400, turns * count)
    columns["time"] = (10**18 + since).reshape(turns, count)
    columns["status"] = 1
    if sensor.profile == "LEGACY":
        columns["frame"] = np.arange(turns)[:, None]
        columns["encoder"] = TICKS // count * np.arange(count)
    else:
        packets["frame"] = np.arange(turns)[:, None]
        packets["serial"] = np.frombuffer(SERIAL.to_bytes(5, "little"), np.uint8)
    words = columns["pixels"]
    around = np.arange(count)[:, None] / count * 2 * np.pi
    for field in (*PROFILES[sensor.profile].ranges, *(each.field for each in kind.channels)):
        mean = (1 << field.bits) * (0.2 + 0.1 * np.sin(around * 3 + field.word))
        values = mean + random.normal(size=(turns, count, lasers)) * mean / 50
        words[..., field.word] |= values.astype(np.uint32) << field.bit
    if is_odd:
        words[:] = random.integers(0, 1 << 32, words.shape, np.uint32)
        columns["status"], columns["time"] = random.integers(0, 9, (2, turns, count))
    packets["columns"] = columns.reshape(turns, -1, 16)
    return [packet.tobytes() for packet in packets.ravel()]


def there_and_back(
    folder: Path, data: bytes, options: CodingOptions | None = None
) -> RecordingSummary:
    (folder / "drive.pcap").write_bytes(data)
    account = compress(folder / "drive.pcap", folder / "drive.puck", options)
    (folder / "elsewhere").mkdir(exist_ok=True)
    decompress(folder / "drive.puck", folder / "elsewhere" / "back.pcap")
    assert (folder / "elsewhere" / "back.pcap").read_bytes() == data
    return account


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("is_odd", [False, True])
def test_packets_of_each_profile_come_back(tmp_path: Path, profile: str, is_odd: bool) -> None:
    packets = sent(sensor_of(tmp_path, profile), is_odd=is_odd)
    account = there_and_back(tmp_path, capture(packets, WHOLE))
    assert account.packets == 64
    assert account.turns == 2 or is_odd  # odd packets have no clock by which they are in order
    if not is_odd:
        assert account.compressed < 0.8 * len(lzma.compress(b"".join(packets)))


@pytest.mark.parametrize("effort", ["fast", "normal", "thorough"])
def test_efforts_and_key_turns(tmp_path: Path, effort: str) -> None:
    packets = sent(sensor_of(tmp_path, "RNG19_RFL8_SIG16_NIR16_DUAL"), turns=3)
    options = CodingOptions(effort=effort, key_every=2)
    assert there_and_back(tmp_path, capture(packets, WHOLE), options).turns == 3


def test_ip_fragments_are_joined(tmp_path: Path) -> None:
    packets = sent(sensor_of(tmp_path, "LEGACY"))
    account = there_and_back(tmp_path, capture(packets))
    assert account.packets == 64
    whole = there_and_back(tmp_path, capture(packets, WHOLE))
    assert account.compressed < 1.1 * whole.compressed


@pytest.mark.parametrize("profile", ["RNG15_RFL8_NIR8", "RNG19_RFL8_SIG16_NIR16_DUAL", "LEGACY"])
def test_turns_of_a_compressed_recording_can_be_had(profile: str, tmp_path: Path) -> None:
    """Of profiles with signals, reflectivities are among the fields."""
    sensor = sensor_of(tmp_path, profile)
    packets = sent(sensor)
    there_and_back(tmp_path, capture(packets, WHOLE))
    stream = (tmp_path / "drive.puck").read_bytes()
    payloads = np.frombuffer(b"".join(packets), np.uint8).reshape(len(packets), -1)
    decoded = decode_turns(stream)
    parts = list(OusterKind.of(sensor).split_turns(payloads))
    for turn, (kind, part) in zip(decoded, parts, strict=True):
        np.testing.assert_array_equal(turn.ranges, kind.turn_of(part).ranges)
    expected = ouster_turns(sensor, payloads).returns
    reflectivities = replace(expected, turns=tuple(decoded)).reflectivities()
    np.testing.assert_array_equal(reflectivities, expected.reflectivities())
    (last,) = decode_turns(stream, 1, 2)
    np.testing.assert_array_equal(last.reflectivities, decoded[1].reflectivities)


def test_metadata_travel_in_the_recording(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    packets = sent(sensor_of(tmp_path, "RNG15_RFL8_NIR8"))
    data = capture(packets, WHOLE)
    text = (tmp_path / "drive.json").read_bytes()
    account = there_and_back(tmp_path, data)
    assert account.metadata == text
    assert account.parts["metadata"] < len(text)
    beside = tmp_path / "elsewhere" / "back.json"
    assert beside.read_bytes() == text
    for name, content in [("back_0.json", b"{}"), ("back.json", b"[]")]:
        beside.unlink()
        (other := tmp_path / "elsewhere" / name).write_bytes(content)
        caplog.clear()
        there_and_back(tmp_path, data)
        assert other.read_bytes() == content
        assert beside.exists() == (beside == other)
        assert f"{name}: differs from the metadata in the compressed recording" in caplog.text
        other.rename(beside)
    (tmp_path / "elsewhere" / "b.json").write_bytes(text)
    beside.unlink()
    there_and_back(tmp_path, data)
    assert not beside.exists()


def test_metadata_of_no_packet_do_not_travel(tmp_path: Path) -> None:
    sensor_of(tmp_path, "RNG15_RFL8_NIR8")
    with_metadata = there_and_back(tmp_path, bytes(10_000))
    (tmp_path / "drive.json").unlink()
    assert there_and_back(tmp_path, bytes(10_000)) == with_metadata


def test_lost_damaged_and_late_packets_and_others_come_back(tmp_path: Path) -> None:
    packets = sent(sensor_of(tmp_path, "RNG19_RFL8_SIG16_NIR16"))
    random = np.random.default_rng(1)
    damaged = bytearray(packets[7])
    damaged[40:42] = b"\xff\xff"  # the number of a column
    mixed = [*packets[3:7], bytes(damaged), *packets[9:12], packets[8], b"\1" * 48, packets[8]]
    mixed += [packets[12][:-700], random.bytes(len(packets[0])), *packets[40:]]
    account = there_and_back(tmp_path, capture(mixed, WHOLE))
    assert account.packets == 4 + 3 + 2 + 24
    for size in (-1, -700, -2 * len(packets[0])):
        there_and_back(tmp_path, capture(mixed, WHOLE)[:size])


def test_windows_cut_no_packet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packets = sent(sensor_of(tmp_path, "RNG15_RFL8_NIR8"))
    monkeypatch.setattr("puck.recording._WINDOW", 20_001)
    assert there_and_back(tmp_path, capture(packets)).packets == 64


def test_checks_of_packets_are_computed(tmp_path: Path) -> None:
    """The CRC-64 is that of xz, whose check of "123456789" is known."""
    from puck.recordings import ouster_packets

    text = np.frombuffer(b"123456789" + bytes(8), np.uint8)[None]
    check = int.from_bytes(ouster_packets.checks_of(text).tobytes(), "little")
    assert check == 0x995DC9BBDF1939FA
    sensor = sensor_of(tmp_path, "RNG15_RFL8_NIR8")
    packets = np.frombuffer(b"".join(sent(sensor)), np.uint8).reshape(64, -1).copy()
    packets[:, -8:] = ouster_packets.checks_of(packets)
    checked = there_and_back(tmp_path, capture([row.tobytes() for row in packets], WHOLE))
    packets[5, -1] ^= 1
    stored = there_and_back(tmp_path, capture([row.tobytes() for row in packets], WHOLE))
    assert checked.compressed < stored.compressed - 8 * 32


def test_without_metadata_nothing_is_modelled(tmp_path: Path) -> None:
    packets = sent(sensor_of(tmp_path, "RNG15_RFL8_NIR8"))
    for text in (None, "{}", "not JSON"):
        (tmp_path / "drive.json").unlink(missing_ok=True)
        if text is not None:
            (tmp_path / "drive.json").write_text(text)
        assert there_and_back(tmp_path, capture(packets, WHOLE)).packets == 0


def test_damaged_streams_end_in_one_error(tmp_path: Path) -> None:
    """Also where all checksums are right."""
    from io import BytesIO

    from puck.gaps import compress_bytes
    from puck.records import Record, RecordKind, join_records, read_records

    packets = sent(sensor_of(tmp_path, "RNG19_RFL8_SIG16_NIR16_DUAL"), turns=1)
    there_and_back(tmp_path, capture(packets, WHOLE), CodingOptions(effort="fast"))
    records = list(read_records(BytesIO((tmp_path / "drive.puck").read_bytes())))[:-1]
    kinds = [record.kind for record in records]
    of_turn = [RecordKind.LAYOUT, RecordKind.TURN, RecordKind.FIELDS, RecordKind.GAPS]
    assert kinds == [RecordKind.METADATA, *of_turn]
    metadata, *records = records
    layout, turn, fields, gaps = records
    foreign = Record(RecordKind.METADATA, compress_bytes(b"{}"))
    cut = Record(RecordKind.METADATA, metadata.body[:-9])
    broken = [
        [foreign, *records], [cut, *records],
        [layout, turn, gaps], [layout, fields, gaps], [layout, turn, turn, fields, gaps],
        [layout, turn, layout, fields, gaps], [fields], [layout, turn, fields, fields, gaps],
    ]  # fmt: skip
    random = np.random.default_rng(0)
    for _ in range(60):
        number = int(random.integers(3))
        body = bytearray(records[number].body)
        body[random.integers(min(len(body), 40) if random.random() < 0.5 else len(body))] ^= (
            1 << int(random.integers(8))
        )
        changed = [*records]
        changed[number] = Record(records[number].kind, bytes(body))
        broken.append(changed)
    broken.append([layout, turn, Record(RecordKind.FIELDS, fields.body[:200]), gaps])
    for each in broken:
        (tmp_path / "bad.puck").write_bytes(join_records(each))
        with pytest.raises(InputError, match=r"bad\.puck"):
            decompress(tmp_path / "bad.puck", tmp_path / "out")
        assert not (tmp_path / "out").exists()


RECORDINGS = sorted((Path(__file__).parents[2] / "data" / "ouster_recordings").glob("*.pcap"))


@pytest.mark.skipif(not RECORDINGS, reason="needs puckbench data ouster_recordings")
def test_real_recordings_take_65_percent_of_xz(tmp_path: Path) -> None:
    for path in RECORDINGS:
        data = path.read_bytes()
        name = path.name.replace("_lb_n3", "").replace(".pcap", ".json")
        (tmp_path / "drive.json").write_bytes(path.with_name(name).read_bytes())
        account = there_and_back(tmp_path, data)
        assert account.compressed < 0.65 * len(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))
