"""Recordings of an HDL-64E read with its unit's calibration, and without."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from puckbench.recordings.reading import read_recording, read_turns
from tests.support.spinning import HDL64E, pcap, rows, spin

NOMINAL = load_sensor("hdl64e_s3")
FIELDS = [name for name in Sensor.model_fields if "correction" in name or name[:6] == "laser_"]


def unit() -> Sensor:
    """An HDL-64E S3 other than the nominal one; its message has steps of 0.01 degrees and 1 mm."""
    moved = {
        name: tuple(round(value + step, 2) for value in getattr(NOMINAL, name))
        for step, name in enumerate(FIELDS, start=1)
    }
    return NOMINAL.replaced(**moved)


def numbers(sensor: Sensor) -> list[tuple[float, ...]]:
    return [
        (elevation, -azimuth, *millimetres)
        for elevation, azimuth, *millimetres in zip(
            sensor.laser_elevation_deg, sensor.laser_azimuth_deg or (),
            sensor.distance_correction_mm or (), sensor.distance_correction_x_mm or (),
            sensor.distance_correction_y_mm or (), sensor.vertical_correction_mm or (),
            sensor.horizontal_correction_mm or (), strict=True,
        )
    ]  # fmt: skip


def status(sensor: Sensor, packets: int, first: int) -> NDArray[np.uint8]:
    """The last bytes of packets (p, 2): types, and values of a message of 1,820 bytes.

    After the start, a laser has four cycles of seven bytes, the fourth of which begins with a
    warning; other types, such as the hour, are in between.
    """
    message = b"UNIT#\x18\x18"
    for laser, (elevation, rotation, *lengths) in enumerate(numbers(sensor)):
        scaled = [round(100 * elevation), round(100 * rotation), *map(round, lengths)]
        message += struct.pack("<B7h", laser, *scaled).ljust(28, b"\0")
    message = message.ljust(1820, b"\0")
    result = np.zeros((packets, 2), np.uint8)
    for row, number in enumerate(range(first, first + packets)):
        cycle, place = divmod(number % 4160, 16)
        kind = b"HMSDNYGTV1234567"[place]
        value = 7 if place < 9 else message[7 * cycle + place - 9]
        if cycle and cycle % 4 == 0 and place == 9:
            kind = ord("W")
        result[row] = kind, value
    return result


def ros(sensor: Sensor) -> str:
    lines = ["lasers:"]
    for laser, (elevation, rotation, *lengths) in enumerate(numbers(sensor)):
        far, x, y, height, sideways = (length / 1000 for length in lengths)
        lines.append(
            f"- {{laser_id: {laser}, rot_correction: {np.radians(rotation)}, "
            f"vert_correction: {np.radians(elevation)}, dist_correction: {far}, "
            f"dist_correction_x: {x}, dist_correction_y: {y}, vert_offset_correction: {height}, "
            f"horiz_offset_correction: {sideways}}}"
        )
    return "\n".join([*lines, "num_lasers: 64", "distance_resolution: 0.002"])


def xml(sensor: Sensor) -> str:
    names = (
        "vert",
        "rot",
        "dist",
        "distCorrectionX",
        "distCorrectionY",
        "vertOffset",
        "horizOffset",
    )
    tags = [name if "Correction" in name else f"{name}Correction" for name in names]
    points = ""
    for laser, (elevation, rotation, *lengths) in enumerate(numbers(sensor)):
        values = [elevation, rotation, *(length / 10 for length in lengths)]
        inner = "".join(
            f"<{tag}_>{value}</{tag}_>\n" for tag, value in zip(tags, values, strict=True)
        )
        points += f'<item><px class_id="9">\n<id_>{laser}</id_>\n{inner}</px></item>\n'
    return f"<boost_serialization><DB><points_>{points}</points_></DB></boost_serialization>"


def write(path: Path, ends: NDArray[np.uint8]) -> Path:
    packets = spin(HDL64E, packets=len(ends), rise=20)
    packets[:, -2:] = ends
    path.write_bytes(pcap(rows(packets)))
    return path


@pytest.mark.parametrize(("suffix", "text"), [(".xml", xml(unit())), (".yaml", ros(unit()))])
def test_a_file_beside_a_recording_describes_its_unit(
    suffix: str, text: str, tmp_path: Path
) -> None:
    (beside := tmp_path / f"a{suffix}").write_text(text)
    sensor = load_sensor(beside)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(sensor, name), getattr(unit(), name), atol=1e-6)
    path = write(tmp_path / "a.pcap", status(NOMINAL, 32, first=64))
    points = read_recording(path).xyz
    beside.rename(tmp_path / f"b{suffix}")
    by_option = read_recording(path, load_sensor(tmp_path / f"b{suffix}")).xyz
    np.testing.assert_array_equal(points, by_option)


def test_without_a_calibration_a_nominal_one_is_used_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path / "a.pcap", status(unit(), 32, first=64))
    returns = read_turns(path).returns
    assert returns.beams.elevations_deg == NOMINAL.laser_elevation_deg
    assert "nominal angles and distances of an HDL-64E's lasers; put" in caplog.text
    assert returns.sensor == "HDL-64E S3"
    other = write(tmp_path / "b.pcap", np.full((32, 2), ord("H"), np.uint8))
    older = read_turns(other).returns
    assert older.sensor == "HDL-64E S2"
    assert older.beams.delays[63] == pytest.approx(45.66 / 48)
