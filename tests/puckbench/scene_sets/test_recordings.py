"""Recordings as a data set: whole turns, by name."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.return_table import read_return_table
from pointkit.lidar.returns import Returns, read_firings
from puck import compress
from puck.recordings.packet_turns import returns_of_packets
from puckbench.cli import main
from puckbench.recordings import reading
from puckbench.recordings.reading import read_packets, read_recording, read_turns
from puckbench.scene_sets import recordings
from puckbench.scene_sets.registry import open_scene_set
from tests.puckbench.recordings.test_recording_files import bag
from tests.support.capture_lookalike import scan_message
from tests.support.spinning import DUAL, HDL32E, HDL64E, STRONGEST, VLP16, VLS128, pcap, rows, spin


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of some 5 and some 2 turns, and a file that is none."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, packets in (("drive b", 100), ("a", 42)):
        payloads = [bytes(item) for item in spin(packets=packets, rise=160)]
        (folder / f"{name}.pcap").write_bytes(pcap(payloads))
    (folder / "notes.txt").write_text("nothing")
    return folder


def test_whole_turns_are_taken_by_file_and_number(folder: Path) -> None:
    scenes = open_scene_set("recordings", {"path": str(folder)})
    # 100 packets of 12 blocks by 1.6 degrees: from 14 degrees on, 5.3 turns.
    assert scenes.names() == ["a_0001", *(f"drive_b_000{turn}" for turn in (1, 2, 3, 4))]
    scene = scenes.load("drive_b_0002")
    assert scene.group == "drive_b"
    assert scene.returns is not None
    (turn,) = scene.returns.turns
    assert 360 / 1.6 - 13 < len(turn.azimuths) < 360 / 1.6 + 13
    assert scenes.files("drive_b_0002") == [folder / "drive b.pcap"]
    assert scene.about["first_turn"] == 2


def test_turns_are_joined_and_left_out(folder: Path) -> None:
    path = str(folder / "drive b.pcap")
    scenes = open_scene_set("recordings", {"path": path, "turns": 2})
    assert scenes.names() == ["drive_b_0001", "drive_b_0003"]
    single = open_scene_set("recordings", {"path": path, "every": 3})
    assert single.names() == ["drive_b_0001", "drive_b_0004"]
    both = scenes.load("drive_b_0003").returns
    parts = [single.load("drive_b_0004").returns]
    assert both is not None
    assert parts[0] is not None
    np.testing.assert_array_equal(both.turns[1].ranges, parts[0].turns[0].ranges)


def test_a_start_can_be_left_out(folder: Path) -> None:
    path = str(folder / "drive b.pcap")
    whole = open_scene_set("recordings", {"path": path}).names()
    later = open_scene_set("recordings", {"path": path, "start_s": 0.05}).names()
    assert 1 <= len(later) < len(whole)


def test_what_is_missing_is_told(folder: Path, tmp_path: Path) -> None:
    for path, why in (
        (tmp_path / "none", "no such file or folder"),
        (tmp_path, "no recordings"),
        (folder / "notes.txt", "notes.txt"),
    ):
        with pytest.raises(InputError, match=why):
            open_scene_set("recordings", {"path": str(path)}).load("notes")
    (tmp_path / "again").symlink_to(folder / "a.pcap")
    with pytest.raises(InputError, match="named twice"):
        open_scene_set(
            "recordings", {"path": [str(folder / "a.pcap"), str(tmp_path / "again")]}
        ).names()
    short = tmp_path / "short.pcap"
    short.write_bytes(pcap([bytes(item) for item in spin(packets=4)]))
    unusable = open_scene_set("recordings", {"path": str(short)})
    assert unusable.names() == ["short"]
    with pytest.raises(InputError, match=r"short\.pcap: no whole turn"):
        unusable.load("short")
    with pytest.raises(InputError, match="no scene 'a_0009'"):
        open_scene_set("recordings", {"path": str(folder)}).load("a_0009")


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the recordings that are read."""
    result: list[str] = []

    def counted(path: Path, *options: Any) -> tuple[Returns, dict[str, int]]:
        result.append(path.name)
        return reading_turns(path, *options)

    reading_turns = reading.read_turns
    monkeypatch.setattr(reading, "read_turns", counted)
    monkeypatch.setattr(recordings, "_kept", {})
    return result


def test_a_cloud_is_found_without_reading_other_recordings(folder: Path, reads: list[str]) -> None:
    scenes = open_scene_set("recordings", {"path": str(folder)})
    assert scenes.files("drive_b_0002") == [folder / "drive b.pcap"]
    assert not reads
    scenes.load("drive_b_0002")
    scenes.load("drive_b_0003")
    assert reads == ["drive b.pcap"]
    alone = open_scene_set("recordings", scenes.options_of("a_0001"))  # type: ignore[attr-defined]
    assert alone.files("a_0001") == [folder / "a.pcap"]
    assert alone.names() == ["a_0001"]
    assert reads == ["drive b.pcap", "a.pcap"]


def test_recordings_are_read_once_in_a_process(folder: Path, reads: list[str]) -> None:
    for _ in range(2):
        scenes = open_scene_set("recordings", {"path": str(folder)})
        for name in scenes.names():
            scenes.load(name)
    assert sorted(reads) == ["a.pcap", "drive b.pcap"]


def test_of_large_recordings_the_last_is_kept(
    folder: Path, reads: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings, "_MOST_KEPT", 1000)
    open_scene_set("recordings", {"path": str(folder)}).names()
    open_scene_set("recordings", {"path": str(folder / "drive b.pcap")}).names()
    open_scene_set("recordings", {"path": str(folder / "a.pcap")}).names()
    assert reads == ["a.pcap", "drive b.pcap", "a.pcap"]


def test_a_recording_that_changes_is_read_again(tmp_path: Path, reads: list[str]) -> None:
    path = tmp_path / "a.pcap"
    for packets in (42, 100):
        path.write_bytes(pcap(rows(spin(packets=packets))))
        count = len(open_scene_set("recordings", {"path": str(path)}).names())
    assert count == 4
    assert len(reads) == 2


def test_patterns_subfolders_and_folders_of_bags_are_read(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for place in ("drives/one", "drives/two", "drives/.hidden", "bags/first", "bags/second"):
        Path(place).mkdir(parents=True)
        Path(place, "run.pcap").write_bytes((folder / "a.pcap").read_bytes())
    for name in ("first", "second"):
        Path("bags", name, "metadata.yaml").touch()

    def places(path: object) -> list[Path]:
        scenes = open_scene_set("recordings", {"path": path})
        return list(scenes._recordings.values())  # type: ignore[attr-defined]

    both = [Path("drives/one/run.pcap"), Path("drives/two/run.pcap")]
    assert places("drives") == places("drives/*/*.pcap") == places("drives/**/*.pcap") == both
    assert places("bags") == places("bags/*") == [Path("bags/first"), Path("bags/second")]
    assert places(["bags/first", "drives/one"]) == [Path("bags/first"), both[0]]
    names = open_scene_set("recordings", {"path": "drives"}).names()
    assert names == ["one-run_0001", "two-run_0001"]
    with pytest.raises(InputError, match="no such file or folder"):
        places("drives/*.bag")


def test_a_recording_that_cannot_be_used_is_named(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "good.pcap").write_bytes((folder / "a.pcap").read_bytes())
    (tmp_path / "torn.pcap").write_bytes(b"no capture at all")
    (tmp_path / "short.pcap").write_bytes(pcap(rows(spin(packets=4))))
    scenes = open_scene_set("recordings", {"path": str(tmp_path)})
    assert scenes.names() == ["short", "torn", "good_0001"]
    for name, why in (("torn", "torn.pcap"), ("short", "no whole turn")):
        assert scenes.files(name) == [tmp_path / f"{name}.pcap"]
        with pytest.raises(InputError, match=why):
            scenes.load(name)


def test_a_compressed_recording_is_read_as_the_one_it_was_made_of(
    folder: Path, tmp_path: Path
) -> None:
    compress(folder / "drive b.pcap", tmp_path / "small.puck")
    scenes = open_scene_set("recordings", {"path": str(tmp_path)})
    assert scenes.names() == [f"small_000{turn}" for turn in (1, 2, 3, 4)]
    result = scenes.load("small_0003").returns
    plain = open_scene_set("recordings", {"path": str(folder)}).load("drive_b_0003").returns
    assert result is not None
    assert plain is not None
    np.testing.assert_array_equal(result.turns[0].ranges, plain.turns[0].ranges)
    (tmp_path / "small.pcap").write_bytes((folder / "drive b.pcap").read_bytes())
    again = open_scene_set("recordings", {"path": str(tmp_path)})
    assert again.files("small_0001") == [tmp_path / "small.pcap"]
    (tmp_path / "small.pcap").unlink()
    (tmp_path / "small.puck").write_bytes((tmp_path / "small.puck").read_bytes()[:-9])
    with pytest.raises(InputError, match=r"small\.puck: the stream is damaged"):
        open_scene_set("recordings", {"path": str(tmp_path)}).load("small")


@pytest.mark.parametrize("product", [VLP16, HDL32E, HDL64E, VLS128])
@pytest.mark.parametrize("mode", [STRONGEST, DUAL])
def test_every_sensor_and_return_mode_comes_by_turns(
    tmp_path: Path, product: int, mode: int
) -> None:
    packets = spin(product, mode, packets=100, rise=1000 if product in (HDL64E, VLS128) else 160)
    (tmp_path / "a.pcap").write_bytes(pcap(rows(packets)))
    scenes = open_scene_set("recordings", {"path": str(tmp_path)})
    whole = returns_of_packets(packets)
    if product == HDL64E:  # packets of an S2
        whole = read_turns(tmp_path / "a.pcap").returns
    assert len(scenes.names()) == len(whole.turns) - 2 >= 1
    for number, name in enumerate(scenes.names(), start=1):
        result = scenes.load(name).returns
        assert result is not None
        assert result.layout.kinds == (2 if mode == DUAL else 1)
        np.testing.assert_array_equal(result.points(), replace_turns(whole, number).points())


@pytest.mark.parametrize("product", [VLP16, HDL32E])
@pytest.mark.parametrize("mode", [STRONGEST, DUAL])
def test_bags_have_the_turns_of_their_packets(tmp_path: Path, product: int, mode: int) -> None:
    packets = spin(product, mode, packets=100)
    (tmp_path / "a.pcap").write_bytes(pcap(rows(packets)))
    (tmp_path / "drive").mkdir()
    bag(tmp_path / "drive/drive_0.db3", [scan_message(part) for part in np.split(packets, 4)])
    scenes = open_scene_set("recordings", {"path": str(tmp_path)})
    own = [name for name in scenes.names() if name.startswith("drive_0")]
    assert len(own) == len(scenes.names()) // 2 >= 1
    for name in own:
        result, same = scenes.load(name), scenes.load(name.replace("drive_0", "a"))
        assert result.returns is not None
        assert same.returns is not None
        np.testing.assert_array_equal(result.returns.points(), same.returns.points())


@pytest.mark.parametrize("suffix", ["pcap", "puck"])
def test_turns_of_a_recording_are_prepared_by_the_command(tmp_path: Path, suffix: str) -> None:
    packets = spin(packets=60)
    (tmp_path / "a.pcap").write_bytes(pcap(rows(altered(packets, {(25, 0): 0}))))
    compress(tmp_path / "a.pcap", tmp_path / "a.puck")
    out = tmp_path / "turn.ply"
    assert main(["prepare", str(tmp_path / f"a.{suffix}"), str(out)]) == 0
    result = read_firings(tmp_path / "turn.parquet")
    whole = returns_of_packets(np.delete(packets, 25, axis=0))
    np.testing.assert_array_equal(result.turns[0].ranges, whole.turns[1].ranges)
    about = json.loads(out.with_suffix(".json").read_text())
    assert about["damaged_packets"] == 1
    assert about["source"] == f"a.{suffix}"


def mixed(folder: Path) -> tuple[str, list[str]]:
    """A capture of two sensors with one address that send to two ports, and these streams."""
    near, far = rows(spin(packets=60)), rows(spin(packets=60, seed=1))
    data = pcap([item for pair in zip(near, far, strict=True) for item in pair])
    size = 16 + 42 + 1206
    frames = [data[at : at + size] for at in range(24, len(data), size)]
    port = (2369).to_bytes(2, "big")
    moved = [
        item[:52] + port + item[54:] if number % 2 else item for number, item in enumerate(frames)
    ]
    (folder / "two.pcap").write_bytes(data[:24] + b"".join(moved))
    (folder / "near.pcap").write_bytes(pcap(near))
    (folder / "far.pcap").write_bytes(pcap(far))
    names = [f"192.168.1.201:2368 to 255.255.255.255:{number}" for number in (2368, 2369)]
    return str(folder / "two.pcap"), names


def test_one_of_two_sensors_is_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, streams = mixed(tmp_path)
    with pytest.raises(InputError, match="data packets of 2 streams"):
        open_scene_set("recordings", {"path": path}).load("two")
    for stream, name in zip(streams, ("near", "far"), strict=True):
        alone = read_packets(tmp_path / f"{name}.pcap").payloads
        result = open_scene_set("recordings", {"path": path, "stream": stream}).load("two_0001")
        assert result.returns is not None
        turn = returns_of_packets(alone).turns[1]
        np.testing.assert_array_equal(result.returns.turns[0].ranges, turn.ranges)
        out = tmp_path / f"{name}.parquet"
        assert main(["capture", path, str(out), "--stream", stream]) == 0
        assert len(read_return_table(out)) == len(read_recording(tmp_path / f"{name}.pcap"))
        assert main(["prepare", path, str(tmp_path / "c.ply"), "--stream", stream]) == 0
        ranges = read_firings(tmp_path / "c.parquet").turns[0].ranges
        np.testing.assert_array_equal(ranges, turn.ranges)
    capsys.readouterr()
    assert main(["capture", path, str(tmp_path / "none.parquet")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert all(f"{stream}, 60 packets of VLP-16" in line for stream in streams)
    assert not (tmp_path / "none.parquet").exists()


def test_a_bag_has_no_streams(tmp_path: Path) -> None:
    bag(tmp_path / "a.db3", [scan_message(spin(packets=4))])
    with pytest.raises(
        InputError, match=r"a\.db3: stream '10\.0\.0\.1': only packet captures have streams"
    ):
        read_packets(tmp_path / "a.db3", "10.0.0.1")


def test_a_bag_is_sifted_as_a_capture(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    packets = spin(packets=40)
    faulty = np.concatenate(
        [packets, packets[:3], packets[:1] * 0, altered(packets[:1], {(0, 0): 0})]
    )
    log = read_packets(bag(tmp_path / "a.db3", [scan_message(faulty)]))
    np.testing.assert_array_equal(log.payloads, packets)
    parts = {"repeated_packets": 3, "damaged_packets": 1, "foreign_packets": 1}
    assert parts.items() <= log.about.items()
    assert "repeat one before, byte by byte (3), damaged packets (1), datagrams" in caplog.text
    with pytest.raises(InputError, match=r"no whole data packet of a Velodyne: 3 damaged$"):
        read_packets(bag(tmp_path / "b.db3", [scan_message(altered(packets[:3], DAMAGE))]))


DAMAGE = {(number, 0): 0 for number in range(3)}


def test_a_part_of_a_turn_is_prepared_with_a_remark(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "short.pcap"
    path.write_bytes(pcap(rows(spin(packets=8))))
    assert main(["prepare", str(path), str(tmp_path / "a.ply")]) == 0
    remark = f"puckbench: {path}: has no whole turn: takes a part of one"
    assert capsys.readouterr().err.splitlines() == [remark]
    assert main(["prepare", str(path), str(tmp_path / "a.ply"), "--turns", "0"]) == 0
    assert capsys.readouterr().err.splitlines() == [remark]
    longer = tmp_path / "longer.pcap"
    longer.write_bytes(pcap(rows(spin(packets=60))))
    cut = f"puckbench: {longer}: takes turn 0, which is cut off: whole turns are 1 to 2"
    for turns, told in (("0-1", [cut]), ("1", []), ("1-2", [])):
        assert main(["prepare", str(longer), str(tmp_path / "a.ply"), "--turns", turns]) == 0
        assert capsys.readouterr().err.splitlines() == told
    with pytest.raises(InputError, match=r"no whole turn in the recording: of 1 turns"):
        open_scene_set("recordings", {"path": str(path)}).load("short")


def replace_turns(returns: Returns, number: int) -> Returns:
    return list(returns.split())[number]


def loaded(folder: Path, data: bytes) -> tuple[Returns, dict[str, object]]:
    """All whole turns of a capture as one cloud, and what is told of it."""
    (folder / "bad.pcap").write_bytes(data)
    path = str(folder / "bad.pcap")
    turns = len(open_scene_set("recordings", {"path": path}).names())
    scenes = open_scene_set("recordings", {"path": path, "turns": turns})
    scene = scenes.load(scenes.names()[0])
    assert scene.returns is not None
    return scene.returns, scene.about


def altered(packets: np.ndarray, changes: dict[tuple[int, int], int]) -> np.ndarray:
    result = packets.copy()
    for place, value in changes.items():
        result[place] = value
    return result


@pytest.mark.parametrize(
    ("packets", "why"),
    [
        (np.concatenate([spin(packets=60), spin(HDL32E, packets=60)]), "more than one sensor"),
        (np.concatenate([spin(packets=60), spin(mode=DUAL, packets=60)]), "or return mode"),
        (altered(spin(packets=60), {(9, 1205): 0x31}), "packets of Velarray"),
        (altered(spin(packets=60), {(9, 1204): 0x38}), "or return mode"),
        (spin(packets=60) * 0, "60 datagrams of 1,206 bytes to port 2368 .60 without the flags"),
    ],
)
def test_packets_of_several_or_other_sensors_are_refused_in_one_line(
    tmp_path: Path, packets: np.ndarray, why: str
) -> None:
    with pytest.raises(InputError, match=why) as refused:
        loaded(tmp_path, pcap(rows(packets)))
    assert str(tmp_path / "bad.pcap") in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "damage",
    [
        {(30, 0): 0, (31, 500): 0},  # flags
        {(30, 2): 0xFF, (30, 3): 0xFF, (31, 203): 0x8D},  # azimuths of 36,000 and more
    ],
)
def test_damaged_packets_make_no_returns_and_are_counted(
    tmp_path: Path, damage: dict[tuple[int, int], int]
) -> None:
    packets = spin(packets=100)
    result, about = loaded(tmp_path, pcap(rows(altered(packets, damage))))
    assert about["damaged_packets"] == 2
    without = returns_of_packets(np.delete(packets, [30, 31], axis=0))
    expected = without.turns[1:-1]
    np.testing.assert_array_equal(
        np.concatenate([turn.ranges for turn in result.turns], axis=1),
        np.concatenate([turn.ranges for turn in expected], axis=1),
    )


def test_pairs_of_returns_with_two_azimuths_are_damaged(tmp_path: Path) -> None:
    packets = altered(spin(mode=DUAL, packets=150), {(30, 102): 1, (30, 103): 0})
    _, about = loaded(tmp_path, pcap(rows(packets)))
    assert about["damaged_packets"] == 1


@pytest.mark.parametrize("change", [(1204, 0x99), (1205, 0x7F)])
def test_packets_of_unknown_modes_and_products_are_counted(
    tmp_path: Path, change: tuple[int, int]
) -> None:
    byte, value = change
    result, about = loaded(tmp_path, pcap(rows(altered(spin(packets=100), {(30, byte): value}))))
    assert about["unknown_packets"] == 1
    expected = returns_of_packets(np.delete(spin(packets=100), 30, axis=0))
    assert len(result) == sum(turn.returns for turn in expected.turns[1:-1])


def test_a_gap_moves_no_point(tmp_path: Path) -> None:
    packets = spin(packets=100)
    kept = np.delete(packets, np.s_[40:52], axis=0)
    result, about = loaded(tmp_path, pcap(rows(kept)))
    assert "damaged_packets" not in about
    everything = {tuple(point) for point in np.round(returns_of_packets(packets).points(), 6)}
    apart = [tuple(point) in everything for point in np.round(result.points(), 6)]
    # In the block before the gap the azimuth goes on as it usually rises.
    assert np.count_nonzero(np.logical_not(apart)) <= 32
    count = len(returns_of_packets(kept))
    ends = returns_of_packets(kept).turns[0].returns + returns_of_packets(kept).turns[-1].returns
    assert len(result) == count - ends


def test_time_that_runs_backwards_loses_nothing(tmp_path: Path) -> None:
    packets = spin(packets=100)
    swapped = np.arange(100)
    swapped[[50, 51]] = [51, 50]
    result, about = loaded(tmp_path, pcap(rows(packets[swapped])))
    straight, _ = loaded(tmp_path, pcap(rows(packets)))
    assert "damaged_packets" not in about
    assert len(result) == len(straight)
    assert result.seconds == pytest.approx(straight.seconds, rel=1e-6)


def test_turns_of_one_packet_are_turns(tmp_path: Path) -> None:
    packets = spin(packets=20, rise=3000)
    result, _ = loaded(tmp_path, pcap(rows(packets)))
    assert len(result.turns) > 15
    assert {len(turn.azimuths) for turn in result.turns} <= {12, 24}
    whole = returns_of_packets(packets)
    assert len(result) == sum(turn.returns for turn in whole.turns[1:-1])


def test_a_file_that_is_cut_off_gives_its_whole_packets(tmp_path: Path) -> None:
    data = pcap(rows(spin(packets=100)))
    result, about = loaded(tmp_path, data[:-700])
    whole, _ = loaded(tmp_path, pcap(rows(spin(packets=100)[:99])))
    assert about["bytes_cut_off"] == 16 + 42 + 1206 - 700
    assert len(result) == len(whole)
