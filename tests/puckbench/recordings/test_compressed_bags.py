"""Clouds in recordings: every byte of a bag comes back, whatever is in it."""

from __future__ import annotations

import bz2
import io
import lzma
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.coding import zstandard
from pointkit.errors import InputError
from puck import CodingOptions, compress, decode_turns, decompress, recording, records
from puck.__main__ import main
from puck.chunks import Packer
from puck.cloud_messages import find_clouds
from puck.recordings.point_cloud2 import POINT_CLOUD2
from puck.records import Record, RecordKind, join_records, read_records
from tests.support.bag_files import mcap_bytes, ros1_bytes, sqlite_bag
from tests.support.cloud_bags import FORMATS, Rows, cloud_bag, cloud_message
from tests.support.cloud_turns import turns
from tests.support.spinning import pcap, rows, spin
from tests.support.stored_recordings import there_and_back

COMPRESSIONS = [
    ("bag", None), ("bag", "BZ2"), ("bag", "LZ4"), ("db3", None),
    ("mcap", None), ("mcap", "STORAGE"),
]  # fmt: skip


def plain(points: int, seed: int = 0) -> Rows:
    """A cloud without order: coordinates and intensities."""
    random = np.random.default_rng(seed)
    rows = np.zeros(points, [(name, "<f4") for name in ("x", "y", "z", "intensity")])
    for name in ("x", "y", "z"):
        rows[name] = random.normal(0, 10, points)
    rows["intensity"] = random.integers(0, 256, points)
    return rows


def image(rows: int = 16, columns: int = 90) -> Rows:
    """An organised cloud whose points have gaps between their fields."""
    kind = {
        "names": ["x", "y", "z", "rgb"], "formats": ["<f4"] * 4, "offsets": [0, 4, 8, 16],
        "itemsize": 32,
    }  # fmt: skip
    cloud = np.zeros((rows, columns), np.dtype(kind))
    cloud["x"], cloud["y"] = np.arange(columns), np.arange(rows)[:, None]
    return cloud


@pytest.fixture
def only_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """LZMA alone is not tried, which takes fewer bytes of small parts."""
    monkeypatch.setattr(recording, "_ALWAYS_PLAIN", 0)
    monkeypatch.setattr(recording, "_CLOSE", 0)


def topics() -> dict[str, list[Rows]]:
    return {
        "/points": turns(3),
        "/plain": [plain(600 + number, number) for number in range(3)],
        "/image": [image(), image()],
    }


def xz(data: bytes) -> int:
    return len(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))


@pytest.mark.parametrize(("suffix", "compression"), COMPRESSIONS)
def test_the_clouds_of_a_bag_come_back(
    tmp_path: Path, suffix: str, compression: str | None
) -> None:
    path = tmp_path / f"clouds.{suffix}"
    cloud_bag(path, topics(), others={"/note": "some text"}, compression=compression)
    account = there_and_back(tmp_path, path.read_bytes())
    assert (account.clouds, account.packets, account.kept) == (8, 0, 0)
    assert account.points == sum(rows.size for clouds in topics().values() for rows in clouds)
    assert bool(account.opened) == (compression is not None)
    assert account.compressed < xz(path.read_bytes())
    assert account.as_json()["clouds"] == 8


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("effort", ["fast", "thorough"])
def test_each_effort_is_lossless(tmp_path: Path, suffix: str, effort: str) -> None:
    path = cloud_bag(tmp_path / f"clouds.{suffix}", topics())
    settings = CodingOptions(effort=effort, key_every=2)
    assert there_and_back(tmp_path, path.read_bytes(), settings).clouds == 8


def serialised(
    clouds: list[Rows], *, is_ros1: bool, little: bool = True, **changes: Any
) -> list[bytes]:
    """Messages as ROS serialises them; `changes` are other values of their fields."""
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    messages = []
    for number, cloud in enumerate(clouds):
        message = cloud_message(types, cloud, 10**9 * number, is_ros1)
        for name, value in changes.items():
            object.__setattr__(message, name, value)
        if is_ros1:
            messages.append(bytes(types.serialize_ros1(message, POINT_CLOUD2)))
        else:
            messages.append(bytes(types.serialize_cdr(message, POINT_CLOUD2, little_endian=little)))
    return messages


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("kind", ["ros1", "cdr", "cdr big"])
def test_a_message_is_found_wherever_it_begins(kind: str, start: int) -> None:
    cloud = turns(1)[0]
    (message,) = serialised([cloud], is_ros1=kind == "ros1", little="big" not in kind)
    (found,) = find_clouds(bytes(start) + message + b"\1\0\0\0x")
    assert (found.width, found.height, found.points) == (len(cloud), 1, len(cloud))
    data = (bytes(start) + message)[found.start : found.end]
    assert data == cloud.tobytes()
    assert found.frame == b"sensor"
    names = [each.name for each in found.layout.fields]
    assert names == ["x", "y", "z", "intensity", "ring", "time"]
    assert found.layout.point_step == cloud.itemsize


def odd_messages() -> dict[str, bytes]:
    some = turns(2)
    swapped = [cloud.astype(cloud.dtype.newbyteorder(">")) for cloud in some]
    (one,) = serialised(some[:1], is_ros1=False)
    size = some[0].nbytes
    return {
        "big-endian data": b"".join(serialised(swapped, is_ros1=True, is_bigendian=True)),
        "a flag that lies": b"".join(serialised(some, is_ros1=False, is_bigendian=True)),
        "rows with gaps": b"".join(
            serialised([image(4, 9)], is_ros1=True, width=8, row_step=9 * 32, height=4)
        ),
        "a wrong number of rows": b"".join(serialised(some, is_ros1=False, height=7)),
        "a wrong width": b"".join(serialised(some, is_ros1=True, width=10**9)),
        "a cut message": one[: -size // 2] + b"".join(serialised(some, is_ros1=False)),
        "cut off": one + one[: size // 2],
        "cut off in a header": one + one[:120],
        "many": b"".join(serialised(turns(1) * 40, is_ros1=True)),
        "an image of one column": b"".join(serialised([image(30, 1)], is_ros1=False)),
    }


@pytest.mark.usefixtures("only_models")
@pytest.mark.parametrize("name", odd_messages())
@pytest.mark.parametrize("window", [1 << 24, 9001])
def test_whatever_is_in_messages_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, window: int
) -> None:
    monkeypatch.setattr(recording, "_WINDOW", window)
    data = odd_messages()[name]
    assert there_and_back(tmp_path, data).clouds >= 1


def test_an_empty_message_is_no_cloud(tmp_path: Path) -> None:
    message = b"".join(serialised([plain(0)], is_ros1=False))
    assert there_and_back(tmp_path, message).clouds == 0


@pytest.mark.usefixtures("only_models")
@pytest.mark.parametrize("window", [5000, 20_000, 60_000, 200_000])
@pytest.mark.parametrize("suffix", FORMATS)
def test_windows_cut_no_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, window: int, suffix: str
) -> None:
    monkeypatch.setattr(recording, "_WINDOW", window)
    clouds = {"/a": [plain(1500, 1)] * 4, "/b": turns(5)}
    path = cloud_bag(tmp_path / f"clouds.{suffix}", clouds)
    assert there_and_back(tmp_path, path.read_bytes()).clouds == 9


@pytest.mark.usefixtures("only_models")
@pytest.mark.parametrize("window", [1 << 24, 30_000])
def test_packets_and_clouds_of_one_file_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, window: int
) -> None:
    monkeypatch.setattr(recording, "_WINDOW", window)
    messages = serialised(turns(3), is_ros1=True)
    packets = rows(spin(packets=50))
    parts = [pcap(packets[k * 10 : k * 10 + 10]) for k in range(5)]
    data = b"".join(parts[:2] + messages[:2] + parts[2:3] + messages[2:] + parts[3:])
    account = there_and_back(tmp_path, data, CodingOptions(effort="fast"))
    assert (account.clouds, account.packets) == (3, 50)
    assert len(decode_turns((tmp_path / "small.puck").read_bytes())) == account.turns


@pytest.mark.usefixtures("only_models")
def test_packets_within_a_cloud_are_its_data(tmp_path: Path) -> None:
    packet = rows(spin(packets=1))[0]
    cloud = np.frombuffer(packet[:1200] * 3, plain(1).dtype)
    data = b"".join(serialised([cloud], is_ros1=True)) + packet
    account = there_and_back(tmp_path, data)
    assert (account.clouds, account.packets) == (1, 1)


@pytest.mark.usefixtures("only_models")
@pytest.mark.parametrize("page", [512, 1024, 4096, 65536])
def test_messages_on_any_pages_are_found(tmp_path: Path, page: int) -> None:
    path = tmp_path / "bag.db3"
    messages = serialised([*turns(6), *[plain(40), plain(2500)] * 3], is_ros1=False)
    with closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA page_size = {page}")
        database.execute("VACUUM")
    sqlite_bag(path, messages, [("/points", POINT_CLOUD2)])
    assert there_and_back(tmp_path, path.read_bytes()).clouds == 12


@pytest.mark.usefixtures("only_models")
def test_a_bag_with_free_pages_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "bag.db3"
    sqlite_bag(path, serialised(turns(9), is_ros1=False), [("/points", POINT_CLOUD2)])
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("DELETE FROM messages WHERE id IN (2, 5, 6)")
        late = [(1, 99, message) for message in serialised([plain(2000)] * 2, is_ros1=False)]
        sql = "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)"
        database.executemany(sql, late)
    assert there_and_back(tmp_path, path.read_bytes()).clouds >= 8


def test_damaged_pages_come_back(tmp_path: Path) -> None:
    path = cloud_bag(tmp_path / "clouds.db3", topics())
    whole, random = path.read_bytes(), np.random.default_rng(0)
    for number in range(12):
        changed = bytearray(whole)
        for place in random.integers(100, len(whole), 1 + 40 * number):
            changed[place] = random.integers(256)
        there_and_back(tmp_path, bytes(changed), CodingOptions(effort="fast"))


@pytest.mark.parametrize(("suffix", "compression"), COMPRESSIONS)
def test_a_cut_bag_comes_back(tmp_path: Path, suffix: str, compression: str | None) -> None:
    path = cloud_bag(tmp_path / f"a.{suffix}", {"/a": turns(2)}, compression=compression)
    whole = path.read_bytes()
    for end in np.linspace(1, len(whole) - 1, 7).astype(int).tolist():
        there_and_back(tmp_path, whole[:end], CodingOptions(effort="fast"))


def test_a_pipe_gives_what_a_file_gives(tmp_path: Path) -> None:
    """Overflow pages of a bag stand out of order, which a pipe cannot write."""
    path = cloud_bag(tmp_path / "clouds.db3", topics())
    small, back = io.BytesIO(), Unseekable()
    compress(io.BytesIO(path.read_bytes()), small)
    compress(path, tmp_path / "small.puck")
    assert small.getvalue() == (tmp_path / "small.puck").read_bytes()
    decompress(tmp_path / "small.puck", back)
    assert back.getvalue() == path.read_bytes()


class Unseekable(io.BytesIO):
    def seekable(self) -> bool:
        return False

    def seek(self, *_: Any) -> int:
        raise io.UnsupportedOperation


def test_chunks_that_cannot_be_made_again_are_kept_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    message = b"".join(serialised(turns(2), is_ros1=True))
    twice = bz2.compress(message[:9000]) + bz2.compress(message[9000:])
    path = tmp_path / "a.bag"
    path.write_bytes(ros1_bytes(twice, "bz2", len(message)))
    account = there_and_back(tmp_path, path.read_bytes())
    assert (account.clouds, account.opened, account.kept) == (0, 0, 1)
    assert main(["compress", str(path), str(tmp_path / "a.puck")]) == 0
    told = caplog.messages[-1]
    assert "1 of 1 compressed chunks are stored as they are" in told
    assert "decompress the bag first" in told


def test_a_chunk_of_another_version_of_its_compressor_is_told(tmp_path: Path) -> None:
    path = cloud_bag(tmp_path / "a.bag", {"/a": turns(4)}, compression="LZ4")
    compress(path, tmp_path / "a.puck")
    stream = list(read_records(io.BytesIO((tmp_path / "a.puck").read_bytes())))
    changed = []
    for record in stream:
        body = record.body
        if record.kind == RecordKind.CHUNKS:
            start = body.index(b"lz4")
            size = body[start - 1]
            method, _, _, flags = body[start : start + size].decode().split()
            other = Packer(method, "0.9", 12, int(flags))
            body = body[: start - 1] + other.packed() + body[start + size :]
        changed.append(Record(record.kind, body))
    end = changed.pop()
    data = join_records(changed)[:-2] + end.packed()
    (tmp_path / "b.puck").write_bytes(data)
    with pytest.raises(InputError, match=r"b\.puck: .*lz4 0\.9"):
        decompress(tmp_path / "b.puck", tmp_path / "b.bag")
    assert not (tmp_path / "b.bag").exists()


def test_a_version_of_a_compressor_is_a_number(tmp_path: Path) -> None:
    """It is printed: no escapes of terminals."""
    for version in ("\x1b]0;text\x07", "1" * 17, ""):
        text = f"lz4 {version} 0 7".encode()
        record = Record(RecordKind.CHUNKS, bytes([1, len(text)]) + text)
        (tmp_path / "a.puck").write_bytes(join_records([record]))
        with pytest.raises(InputError, match=r"a\.puck: the stream is damaged or truncated$"):
            decompress(tmp_path / "a.puck", tmp_path / "out")


def test_chunks_of_nothing_are_opened_only_while_they_are_few(tmp_path: Path) -> None:
    packed = zstandard.compressed(bytes(65536), 3)
    body = struct.pack("<QQQII4sQ", 0, 0, 65536, 0, 4, b"zstd", len(packed)) + packed
    data = b"\x89MCAP0\r\n" + (struct.pack("<BQ", 6, len(body)) + body) * 400
    account = there_and_back(tmp_path, data)
    assert account.opened
    assert account.kept
    assert account.compressed < len(data)


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_bag_without_clouds_is_told_with_its_topics(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, suffix: str
) -> None:
    path = cloud_bag(tmp_path / f"a.{suffix}", {"/empty": []}, others={"/note": "a text"})
    assert main(["compress", str(path), str(tmp_path / "a.puck")]) == 0
    (told,) = caplog.messages
    assert "no PointCloud2 messages" in told
    assert "/note (std_msgs/msg/String: 1)" in told
    assert "/empty (sensor_msgs/msg/PointCloud2: 0)" in told
    assert "decompress" not in told


@pytest.mark.parametrize("suffix", ["db3", "mcap"])
def test_compressed_messages_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, suffix: str
) -> None:
    path = cloud_bag(tmp_path / f"a.{suffix}", {"/a": turns(2)}, compression="MESSAGE")
    account = there_and_back(tmp_path, path.read_bytes())
    assert account.clouds == 0
    assert main(["compress", str(path), str(tmp_path / "a.puck")]) == 0
    (told,) = caplog.messages
    assert "/a (sensor_msgs/msg/PointCloud2: 2), whose messages or chunks are compressed" in told


def test_a_compressed_file_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    whole = cloud_bag(tmp_path / "a.db3", {"/a": turns(2)})
    path = tmp_path / "a.db3.zstd"
    path.write_bytes(zstandard.compressed(whole.read_bytes(), 1))
    assert main(["compress", str(path), str(tmp_path / "a.puck")]) == 0
    assert "compressed by Zstandard: decompress it first" in caplog.messages[0]


def damaged(whole: bytes) -> Iterator[bytes]:
    random = np.random.default_rng(1)
    for number in range(60):
        changed = bytearray(whole)
        if number % 3 == 0:
            changed = changed[: random.integers(len(whole))]
        else:
            changed[random.integers(len(whole))] ^= 1 << random.integers(8)
        yield bytes(changed)


@pytest.mark.parametrize("suffix", ["bag", "db3"])
def test_damaged_streams_end_in_one_error(tmp_path: Path, suffix: str) -> None:
    compression = "LZ4" if suffix == "bag" else None
    path = cloud_bag(tmp_path / f"a.{suffix}", {"/a": turns(2)}, compression=compression)
    compress(path, tmp_path / "a.puck")
    for bad in damaged((tmp_path / "a.puck").read_bytes()):
        (tmp_path / "bad.puck").write_bytes(bad)
        with pytest.raises(InputError, match=r"bad\.puck"):
            decompress(tmp_path / "bad.puck", tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_records_with_false_content_end_in_one_error(tmp_path: Path) -> None:
    """Records whose checksums are right, and whose bodies are changed, missing or doubled."""
    path = cloud_bag(tmp_path / "a.db3", topics())
    whole = pcap(rows(spin(packets=20))) + b"".join(serialised(turns(2), is_ros1=True))
    (tmp_path / "mixed").write_bytes(whole)
    lz4 = cloud_bag(tmp_path / "a.bag", {"/a": turns(2)}, compression="LZ4")
    random = np.random.default_rng(2)
    for source in (path, tmp_path / "mixed", lz4):
        compress(source, tmp_path / "a.puck", CodingOptions(effort="fast"))
        stream = list(read_records(io.BytesIO((tmp_path / "a.puck").read_bytes())))
        for number in range(80):
            place, changed = int(random.integers(len(stream) - 1)), list(stream)
            if number % 4 == 0:
                del changed[place]
            elif number % 4 == 1:
                changed.insert(place, changed[place])
            else:
                body = bytearray(changed[place].body)
                body[random.integers(min(len(body), 40))] ^= 1 << random.integers(8)
                changed[place] = Record(changed[place].kind, bytes(body))
            data = join_records(changed[:-1])[:-2] + changed[-1].packed()
            (tmp_path / "bad.puck").write_bytes(data)
            try:
                decompress(tmp_path / "bad.puck", tmp_path / "out")
            except InputError as error:
                assert "bad.puck" in str(error)  # noqa: PT017
            else:
                assert (tmp_path / "out").read_bytes() == source.read_bytes()
                (tmp_path / "out").unlink()


def test_a_cloud_of_too_many_values_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, number in (("_FEW_RANGES", 9000), ("_RANGES_PER_BYTE", 4), ("_SMALL_BYTES", 0)):
        monkeypatch.setattr(records, name, number)
    empty = np.zeros(20_000, plain(0).dtype)
    (tmp_path / "a").write_bytes(b"".join(serialised([empty] * 2, is_ros1=True)))
    assert there_and_back(tmp_path, (tmp_path / "a").read_bytes()).clouds == 0
    monkeypatch.setattr(recording, "_fits", lambda *_: True)
    compress(tmp_path / "a", tmp_path / "bomb.puck")
    with pytest.raises(InputError, match=r"bomb\.puck: \d+ ranges in \d+ bytes"):
        decompress(tmp_path / "bomb.puck", tmp_path / "out")


def test_a_message_of_an_mcap_file_without_compression_is_found(tmp_path: Path) -> None:
    data = mcap_bytes(serialised(turns(3), is_ros1=False))
    account = there_and_back(tmp_path, data)
    assert (account.clouds, account.opened, account.kept) == (3, 0, 0)


def test_a_map_that_grows_is_no_larger_than_by_lzma(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    whole = np.zeros(6000, plain(1).dtype)
    for axis in "xyz":
        whole[axis] = random.normal(size=6000)
    path = cloud_bag(tmp_path / "map.bag", {"/map": [whole[: 1000 * k] for k in range(1, 7)]})
    account = there_and_back(tmp_path, path.read_bytes())
    assert account.compressed <= 1.01 * len(lzma.compress(path.read_bytes()))


def test_many_topics_of_one_layout_keep_their_streams(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More topics than there are streams, in turn."""
    monkeypatch.setattr(recording, "_ALWAYS_PLAIN", 0)
    monkeypatch.setattr(recording, "_CLOSE", 0)
    clouds = {f"/points_{number}": [plain(20 + 60 * number)] * 2 for number in range(40)}
    path = cloud_bag(tmp_path / "a.bag", clouds)
    assert there_and_back(tmp_path, path.read_bytes()).clouds == 80
