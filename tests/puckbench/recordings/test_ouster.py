"""Ouster's lidar packets against packets laid out by hand and the formula of its documentation."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import puck
import puckbench
from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from pointkit.lidar.return_table import read_return_table
from puck.recordings.ouster import PROFILES, columns_of_turns, read_sensor
from puck.turn_packets import index_turns
from puckbench.cli import main
from puckbench.recordings.reading import read_packets, read_recording, read_turns
from puckbench.scene_sets.recordings import Recordings
from tests.support.bench import ROOT
from tests.support.ouster import (
    FORMATS,
    HEIGHT_MM,
    LIGHT,
    RADIAL_MM,
    capture,
    images,
    metadata,
    packets,
)

DUAL = "RNG19_RFL8_SIG16_NIR16_DUAL"
COARSE = "RNG15_RFL8_NIR8"


def recorded(folder: Path, profile: str, frames: int = 1, nested: bool = True) -> Path:
    """A capture of whole revolutions, and the sensor's metadata beside it."""
    payloads = [
        packet for frame in range(frames) for packet in packets(profile, *images(profile), frame)
    ]
    (folder / "drive.json").write_text(json.dumps(metadata(profile, nested=nested)))
    (folder / "drive.pcap").write_bytes(capture(payloads))
    return folder / "drive.pcap"


@pytest.mark.parametrize("nested", [True, False])
@pytest.mark.parametrize("profile", FORMATS)
def test_every_format_gives_ranges_reflectivities_and_times(
    profile: str, nested: bool, tmp_path: Path
) -> None:
    read = read_turns(recorded(tmp_path, profile, nested=nested))
    returns = read.returns
    ranges, reflectivities = images(profile)
    (turn,) = returns.turns
    assert (read.whole, read.left_out) == (range(1), {})
    np.testing.assert_array_equal(turn.ranges, ranges)
    assert turn.reflectivities is not None
    assert turn.times is not None
    np.testing.assert_array_equal(turn.reflectivities, reflectivities)
    np.testing.assert_array_equal(np.diff(turn.times), 100)
    assert returns.quantum_m == FORMATS[profile][3] / 1000
    assert returns.columns_per_turn == 512


@pytest.mark.parametrize("profile", [COARSE, DUAL])
def test_points_follow_the_formula_of_the_documentation(profile: str, tmp_path: Path) -> None:
    path = recorded(tmp_path, profile)
    about = metadata(profile)["beam_intrinsics"]
    ranges, reflectivities = images(profile)
    expected = []
    for column in range(512):
        for laser in range(16):
            for kind in range(len(ranges)):
                millimetres = float(ranges[kind, column, laser] * FORMATS[profile][3])
                if millimetres == 0:
                    continue
                encoder = 2 * np.pi * (1 - column / 512)
                azimuth = -np.radians(about["beam_azimuth_angles"][laser])
                altitude = np.radians(about["beam_altitude_angles"][laser])
                r = millimetres - RADIAL_MM
                x = r * np.cos(encoder + azimuth) * np.cos(altitude) + RADIAL_MM * np.cos(encoder)
                y = r * np.sin(encoder + azimuth) * np.cos(altitude) + RADIAL_MM * np.sin(encoder)
                z = r * np.sin(altitude)
                sensor = (-x, -y, z + HEIGHT_MM)  # by lidar_to_sensor_transform
                # Ouster's x is forward and its y to the left; ours are to the right and forward.
                expected.append((-sensor[1] / 1000, sensor[0] / 1000, sensor[2] / 1000))
    table = read_recording(path)
    np.testing.assert_allclose(table.xyz, expected, atol=1e-9)
    np.testing.assert_array_equal(
        table["reflectivity"], reflectivities.transpose(1, 2, 0)[ranges.transpose(1, 2, 0) > 0]
    )
    assert table["timestamp"][-1] == pytest.approx(0.0511)


@pytest.mark.parametrize("profile", FORMATS)
def test_tables_have_signals_light_columns_and_times(profile: str, tmp_path: Path) -> None:
    ranges, reflectivities = images(profile)
    signal_bits, (_, width) = LIGHT[profile]
    random = np.random.default_rng(1)
    signals = random.integers(0, 1 << 16, (2, 512, 16))
    light = random.integers(0, 1 << width, (512, 16))
    (path := tmp_path / "drive.pcap").write_bytes(
        capture(packets(profile, ranges, reflectivities, 7, signals, light))
    )
    path.with_suffix(".json").write_text(json.dumps(metadata(profile)))
    main(["capture", str(path), str(tmp_path / "returns.parquet")])
    table = read_return_table(tmp_path / "returns.parquet")
    columns, lasers, kinds = np.nonzero(ranges.transpose(1, 2, 0))
    np.testing.assert_array_equal(table["column"], columns)
    np.testing.assert_array_equal(
        table["clock_time"], 5_000_000_000 + 100_000 * (7 * 512 + columns)
    )
    photons = light if width == 16 else 16 * light
    np.testing.assert_array_equal(table["near_infrared"], photons[columns, lasers])
    assert ("signal" in table.columns) == bool(signal_bits)
    if signal_bits:
        np.testing.assert_array_equal(table["signal"], signals[kinds, columns, lasers])


def test_lost_repeated_and_late_packets(tmp_path: Path) -> None:
    path = recorded(tmp_path, COARSE)
    parts = [
        packets(COARSE, *images(COARSE, seed=frame), frame % 65536) for frame in range(65534, 65539)
    ]
    first, second, third, fourth, last = parts
    sent = [*first[9:], *second[:4], second[6], second[5], second[4], *second[6:], *third[:-2]]
    sent += [fourth[0], third[-1], *fourth[1:], *last[:3]]
    path.write_bytes(capture(sent))
    read = read_turns(path)
    returns = read.returns
    assert [len(turn.azimuths) for turn in returns.turns] == [368, 512, 496, 512, 48]
    assert read.whole == range(1, 4)
    np.testing.assert_array_equal(returns.turns[1].ranges, images(COARSE, seed=65535)[0])
    kept = np.r_[0:480, 496:512]
    np.testing.assert_array_equal(returns.turns[2].ranges, images(COARSE, seed=65536)[0][:, kept])


def test_a_recording_goes_through_every_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded(tmp_path, DUAL, frames=2)
    monkeypatch.chdir(tmp_path)
    assert main(["capture", "drive.pcap", "returns.parquet"]) == 0
    table = read_return_table(Path("returns.parquet"))
    assert table.about["sensor"] == "OS-0-16"
    assert set(table["turn"]) == {0, 1}
    assert main(["prepare", "drive.pcap", "turn.ply", "--turns", "1-1"]) == 0
    original = read_cloud(Path("turn.ply"))
    entry = json.dumps({"metric_rates": {"1mm": {"step_m": 0.001}}})
    for codec in ("puck", "gpcc"):
        words = ["encode", "turn.ply", "turn.bin", "--codec", codec, "--rate", "1mm"]
        assert main([*words, "--entry", entry]) == 0
        assert main(["decode", "turn.bin", "decoded.ply"]) == 0
        decoded = read_cloud(Path("decoded.ply"))
        assert len(decoded) == pytest.approx(len(original), rel=0.01)
        if codec == "puck":
            np.testing.assert_allclose(decoded.xyz, original.xyz, atol=1e-6)
    scenes = Recordings(path="drive.pcap")
    assert scenes.names() == ["drive_0000", "drive_0001"]
    assert scenes.files("drive_0001") == [Path("drive.pcap"), Path("drive.json")]
    assert len(list(puckbench.turns("drive.pcap"))) == 2
    assert main(["compress", "drive.pcap", "drive.puck"]) == 0
    assert len(list(puckbench.turns("drive.puck"))) == 2


def _with(change: dict[str, Any]) -> str:
    about = metadata(COARSE, nested=False)
    form = {**about["data_format"], **change.pop("data_format", {})}
    return json.dumps({**about, "data_format": form, **change})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"32 datagrams of 1,280 bytes, as an Ouster sends: put .* \(drive.json\)$"),
        ("{}", "drive.json: not the metadata of an Ouster sensor"),
        ("[1]", "drive.json: not a JSON object"),
        (
            _with({"data_format": {"udp_profile_lidar": "RNG99"}}),
            "unknown format of packets 'RNG99'",
        ),
        (_with({"beam_azimuth_angles": [0, 1]}), "drive.json: not the metadata"),
        (_with({"data_format": {"columns_per_frame": 500}}), "drive.json: not the metadata"),
        (_with({"data_format": {"columns_per_packet": 1 << 40}}), "drive.json: not the metadata"),
        (_with({"prod_sn": "7"}), r"of the sensor 992137000142, and drive.json .* is of 7$"),
        (
            json.dumps(metadata(DUAL)),
            r"32 datagrams of 1,280 bytes to port 7502, which drive.json \(OS-0-16, .* describe$",
        ),
    ],
)
def test_missing_and_foreign_metadata_are_one_line(
    text: str | None, message: str, tmp_path: Path
) -> None:
    path = recorded(tmp_path, COARSE)
    path.with_suffix(".json").unlink()
    if text is not None:
        path.with_suffix(".json").write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        read_turns(path)
    assert str(path.parent) in str(refused.value)


def test_metadata_may_have_the_beginning_of_the_name(tmp_path: Path) -> None:
    path = recorded(tmp_path, COARSE)
    longer = path.rename(tmp_path / "drive_2.pcap")
    (tmp_path / "d.json").write_text("{}")
    assert len(read_turns(longer).returns.turns) == 1


@pytest.mark.parametrize(
    ("line", "radial_mm"),
    [(None, 12.163), ("OS-1-16", 15.806), ("OS-0-128", 27.67), ("OS-2-64", 13.762)],
)
def test_offsets_that_metadata_lack_are_those_of_the_sdk(
    line: str | None, radial_mm: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    about = metadata("LEGACY", nested=False)
    del about["lidar_origin_to_beam_origin_mm"], about["lidar_to_sensor_transform"]
    del about["data_format"], about["prod_line"]
    (path := recorded(tmp_path, "LEGACY").with_suffix(".json")).write_text(
        json.dumps(about | ({"prod_line": line} if line else {}))
    )
    sensor = read_sensor(path)
    assert (sensor.radial_mm, sensor.profile, sensor.columns) == (radial_mm, "LEGACY", 512)
    assert sensor.height_mm == 36.18
    returns = read_turns(path.with_suffix(".pcap")).returns
    assert returns.range_offset_m == -radial_mm / 1000
    (told,) = (each.message for each in caplog.records if "assumed" in each.message)
    offsets = rf"lidar_origin_to_beam_origin_mm \({radial_mm}\) and lidar_to_sensor_transform"
    assert re.search(
        rf"drive.pcap: offsets assumed as by the SDK: {offsets} \(36.18 mm in z\)$", told
    )


@pytest.mark.parametrize("transform", [[1, 2], [], "", {}, [1.0] * 15])
@pytest.mark.parametrize("name", ["beam_to_lidar_transform", "lidar_to_sensor_transform"])
def test_a_transform_has_16_numbers(name: str, transform: Any, tmp_path: Path) -> None:
    (path := tmp_path / "a.json").write_text(
        json.dumps(metadata("LEGACY", nested=False) | {name: transform})
    )
    with pytest.raises(InputError, match=r"a.json: not the metadata of an Ouster sensor"):
        read_sensor(path)


def test_packets_without_a_serial_number_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    read_turns(recorded(tmp_path, "LEGACY"))
    (told,) = (each.message for each in caplog.records)
    assert re.search(r"drive.pcap: unverified .* no serial number in the packets$", told)
    caplog.clear()
    read_turns(recorded(tmp_path, COARSE))
    assert not caplog.records


@pytest.mark.parametrize(
    ("profile", "sent", "stated", "message"),
    [
        ("LEGACY", 512, 1024, "columns 176 of 90,112 encoder ticks apart, and drive.json .* 1,024"),
        (COARSE, 512, 1024, "3 turns of columns below 512, and drive.json .* of 1,024 columns"),
        (COARSE, 1024, 512, "packets of column 1,023, and drive.json .* of 512 columns per turn"),
        ("LEGACY", 1024, 512, "packets of column 1,023, and drive.json"),
    ],
)
def test_metadata_of_other_columns_are_noticed(
    profile: str, sent: int, stated: int, message: str, tmp_path: Path
) -> None:
    (path := tmp_path / "drive.json").write_text(json.dumps(metadata(profile, columns=stated)))
    payloads = [
        packet
        for frame in range(3)
        for packet in packets(profile, *images(profile, columns=sent), frame)
    ]
    path.with_suffix(".pcap").write_bytes(capture(payloads))
    with pytest.raises(InputError, match=message):
        read_turns(path.with_suffix(".pcap"))


def test_a_compressed_recording_needs_no_metadata_beside_it(tmp_path: Path) -> None:
    path = recorded(tmp_path, DUAL)
    expected = read_recording(path)
    puck.compress(path, tmp_path / "alone.puck")
    index = index_turns(tmp_path / "alone.puck")
    assert index is not None
    assert index.metadata == path.with_suffix(".json").read_bytes()
    path.with_suffix(".json").unlink()
    path.unlink()
    for words in (["capture", "returns.parquet"], ["export", "turn.csv", "--turns", "0"]):
        command, out, *others = words
        assert main([command, str(tmp_path / "alone.puck"), str(tmp_path / out), *others]) == 0
    table = read_return_table(tmp_path / "returns.parquet")
    np.testing.assert_array_equal(table.xyz, expected.xyz)
    np.testing.assert_array_equal(table["clock_time"], expected["clock_time"])
    (whole,) = puckbench.turns(tmp_path / "alone.puck")
    np.testing.assert_array_equal(whole.xyz, expected.xyz)
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "alone.puck",
        "returns.parquet",
        "turn.csv",
    ]


def test_osf_files_are_told_how_to_convert(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (path := tmp_path / "drive.osf").write_bytes(b"4\0\0\0\x14\0\0\0OSF$" + bytes(90))
    for words in (["capture"], ["export"], ["prepare"], ["run"]):
        out = ["--codecs", "puck"] if words == ["run"] else [str(tmp_path / "out.ply")]
        assert main([*words, str(path), *out]) == 2
        assert "ouster-cli source drive.osf save drive.pcap" in capsys.readouterr().err


def test_damaged_packets_are_read_to_an_end(tmp_path: Path) -> None:
    path = recorded(tmp_path, COARSE)
    random = np.random.default_rng(3)
    whole = packets(COARSE, *images(COARSE))
    for _ in range(20):
        sent = [random.bytes(len(whole[0])) if random.random() < 0.3 else item for item in whole]
        path.write_bytes(capture(sent))
        returns = read_turns(path).returns
        assert all(np.isfinite(item.points()).all() for item in returns.split())


RECORDINGS = sorted((ROOT / "data" / "ouster_recordings").glob("*_digest.json"))


@pytest.mark.skipif(not RECORDINGS, reason="needs puckbench data ouster_recordings")
def test_fields_of_real_recordings_have_the_digests_of_the_sdk() -> None:
    for path in RECORDINGS:
        digests = json.loads(path.read_text())["scans"][0]
        recording = path.with_name(path.name.replace("_digest.json", ".pcap"))
        returns = read_turns(recording).returns
        (turn,) = returns.turns
        unit = round(returns.quantum_m * 1000)
        assert turn.reflectivities is not None
        images = {}
        for kind, suffix in zip(range(returns.layout.kinds), ("", "2"), strict=False):
            images[f"RANGE{suffix}"] = turn.ranges[kind].astype("<u4") * np.uint32(unit)
            images[f"REFLECTIVITY{suffix}"] = turn.reflectivities[kind]
        log = read_packets(recording)
        assert log.sensor is not None
        (columns,), profile = (
            columns_of_turns(log.sensor, log.payloads),
            PROFILES[log.sensor.profile],
        )
        for field, suffix in zip(profile.signals, ("", "2"), strict=False):
            images[f"SIGNAL{suffix}"] = field.of(columns["pixels"]).astype("<u2")
        if (light := profile.light_of(columns["pixels"])) is not None:
            images["NEAR_IR"] = light.astype("<u2")
        for name, image in images.items():
            digest = hashlib.md5(image.T.tobytes(), usedforsecurity=False).hexdigest()
            assert digest == digests[name], (path, name)
