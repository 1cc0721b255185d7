"""Calibrations of an HDL-64E from packets and files: the same unit in all three forms."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.lidar.returns import Beams, Returns, read_firings, write_firings
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.turns import Layout, Turn
from pointkit.lidar.unit_calibration import calibration_in_packets
from puck import decode_returns, encode_returns
from puck.recordings.packet_turns import returns_of_packets
from tests.support.spinning import HDL64E, spin

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


def test_packets_repeat_the_calibration_of_their_unit() -> None:
    ends = status(unit(), 2 * 4160, first=1234)
    assert calibration_in_packets(ends) == {name: getattr(unit(), name) for name in FIELDS}
    assert calibration_in_packets(ends[:4160]) is None
    assert calibration_in_packets(np.delete(ends, 5003, axis=0)[: 2 * 4160 - 1234]) is None


@pytest.mark.parametrize(("name", "text"), [("a.xml", "<px></px>"), ("a.yaml", "lasers: [{}]")])
def test_other_files_are_no_calibration(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=f"{name}: not the calibration of an HDL-64E"):
        load_sensor(tmp_path / name)


def test_near_corrections_are_those_of_the_manual_at_its_two_points() -> None:
    """A return at the near point has the near correction of an axis, a far one that of both."""
    beams = Beams((0.0,), (0.0,), (0.0,), range_mm=(1000.0,), near_right_mm=(1100.0,),
                  near_forward_mm=(1300.0,))  # fmt: skip
    layout = Layout((0,))
    at = [(1400, 9000, (2.5, 0.0)), (930, 0, (0.0, 2.23)), (30000, 0, (0.0, 31.0))]
    for count, azimuth, (right, forward) in at:
        turn = Turn(np.full((1, 1, 1), count, np.uint16), np.array([azimuth], np.uint16))
        points = replace(Returns(beams, layout, (), 0.001), turns=(turn,)).points()
        np.testing.assert_allclose(points, [[right, forward, 0.0]], atol=1e-9)


def test_beams_of_a_unit_survive_streams_and_tables(tmp_path: Path) -> None:
    returns = returns_of_packets(spin(HDL64E, packets=9), unit())
    decoded = decode_returns(encode_returns(returns))
    np.testing.assert_array_equal(decoded.points(), returns.points())
    write_firings(tmp_path / "a.parquet", returns)
    again = read_firings(tmp_path / "a.parquet")
    np.testing.assert_array_equal(again.points(), returns.points())
    assert again.beams == returns.beams
