from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.sensors import load_sensor, sensor_names

USERS_OWN = """
name: two lasers
laser_elevation_deg: [-1, 1]
rotation_hz: 10
azimuth_step_deg: 0.2
max_range_m: 30
"""


def test_vlp16_has_the_published_laser_table() -> None:
    sensor = load_sensor("vlp16")
    odd = np.arange(1, 16, 2)
    assert sensor.laser_elevation_deg[0::2] == tuple(odd - 16.0)
    assert sensor.laser_elevation_deg[1::2] == tuple(odd.astype(float))
    assert sum(sensor.laser_elevation_deg) == 0


def test_vlp16_vertical_correction_is_odd_in_the_elevation() -> None:
    sensor = load_sensor("vlp16")
    correction = dict(zip(sensor.laser_elevation_deg, sensor.vertical_correction_mm, strict=True))
    assert correction[-15] == 11.2
    assert correction[13] == -9.7
    assert all(correction[-elevation] == -value for elevation, value in correction.items())


def test_vlp16_fires_sixteen_lasers_300_000_times_a_second() -> None:
    sensor = load_sensor("vlp16")
    assert sensor.lasers / (sensor.firing_sequence_us * 1e-6) == pytest.approx(289_352, abs=1)
    assert sensor.divergence_horizontal_deg == pytest.approx(np.degrees(3.0e-3), abs=0.01)
    assert sensor.divergence_vertical_deg == pytest.approx(np.degrees(1.5e-3), abs=0.005)


@pytest.mark.parametrize(
    ("name", "lasers", "field_of_view", "points_per_second"),
    [
        ("vlp16", 16, (-15, 15), 0.3e6),
        ("puck_hires", 16, (-10, 10), 0.3e6),
        ("hdl32e", 32, (-30.67, 10.67), 0.7e6),
        ("hdl64e_s2", 64, (-24.8, 2.0), 1.333e6),
        ("hdl64e_s3", 64, (-24.0, 2.8), 1.111e6),
        ("vlp32c", 32, (-25, 15), 0.6e6),
        ("alpha_prime", 128, (-25, 15), 2.4e6),
    ],
)
def test_shipped_sensors_have_their_data_sheets_numbers(
    name: str, lasers: int, field_of_view: tuple[float, float], points_per_second: float
) -> None:
    sensor = load_sensor(name)
    angles = sensor.laser_elevation_deg
    assert sensor.lasers == lasers
    assert (min(angles), max(angles)) == pytest.approx(field_of_view, abs=0.1)
    assert lasers / (sensor.firing_sequence_us * 1e-6) == pytest.approx(points_per_second, rel=0.04)
    assert 360 / sensor.azimuth_step_deg == pytest.approx(
        1e6 / sensor.firing_sequence_us / sensor.rotation_hz, rel=0.01
    )


SHIPPED = ["alpha_prime", "hdl32e", "hdl64e_s2", "hdl64e_s3", "puck_hires", "vlp16", "vlp32c"]


def test_every_shipped_sensor_is_tested() -> None:
    assert sensor_names() == SHIPPED


def test_puck_hires_has_two_thirds_of_the_pucks_angles_and_its_corrections_are_odd() -> None:
    puck, fine = load_sensor("vlp16"), load_sensor("puck_hires")
    assert fine.laser_elevation_deg == pytest.approx(
        [angle * 2 / 3 for angle in puck.laser_elevation_deg], abs=0.005
    )
    correction = dict(zip(fine.laser_elevation_deg, fine.vertical_correction_mm, strict=True))
    assert all(correction[-angle] == -value for angle, value in correction.items())


def test_hdl32e_fires_its_lower_and_upper_bank_in_turn_a_third_of_four_degrees_apart() -> None:
    angles = load_sensor("hdl32e").laser_elevation_deg
    assert np.diff(angles[0::2]) == pytest.approx(4 / 3, abs=0.011)
    assert np.diff(angles[1::2]) == pytest.approx(4 / 3, abs=0.011)


@pytest.mark.parametrize(
    ("name", "start_mm"), [("hdl32e", 28.96), ("vlp32c", 42.4), ("alpha_prime", 58.63)]
)
def test_beams_of_sensors_start_at_one_distance_from_the_axis(name: str, start_mm: float) -> None:
    sensor = load_sensor(name)
    heights = -start_mm * np.tan(np.radians(sensor.laser_elevation_deg))
    np.testing.assert_allclose(sensor.vertical_correction_mm, heights, atol=0.051)


def test_a_users_own_sensor_is_a_yaml_file(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(USERS_OWN)
    sensor = load_sensor(path)
    assert (sensor.name, sensor.lasers, sensor.min_range_m) == ("two lasers", 2, 0.0)
    assert load_sensor(str(path)) == sensor
    assert sensor.divergence_horizontal_deg == sensor.divergence_vertical_deg == 0
    assert str(sensor).startswith("Sensor(name='two lasers', laser_elevation_deg=(-1.0, 1.0)")


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ("elevation_deg: 3", "unknown option 'elevation_deg'"),
        ("rotation_hz: fast", "rotation_hz is 'fast', but must be a valid number"),
        ("rotation_hz: .inf", "rotation_hz is inf"),
        ("rotation_hz: 0", "rotation_hz is 0, but must be greater than 0"),
        ("laser_elevation_deg: 3", "laser_elevation_deg is 3, but must be a list"),
        ("laser_elevation_deg: []", "laser_elevation_deg is empty"),
        ("laser_elevation_deg: [-1, 91]", "beyond 90 degrees"),
        ("vertical_correction_mm: [1]", "1 vertical_correction_mm for 2 lasers"),
        ("laser_azimuth_deg: [1]", "1 laser_azimuth_deg for 2 lasers"),
        ("min_range_m: 40", "min_range_m 40.0 is not below max_range_m 30.0"),
        ("min_range_m: -1", "min_range_m is -1, but must be greater than or equal to 0"),
        ("name: 5", "name is 5, but must be a valid string"),
        ("laser_elevation_deg: [1, 1]", "has the same angle twice"),
        ("firing_interval_us: 2", "need firing_sequence_us"),
        ("firing_sequence_us: 55.6\nfiring_offsets_us: [0]", "1 firing_offsets_us for 2 lasers"),
        (
            "firing_sequence_us: 55.6\nfiring_offsets_us: [0, 1]\nfiring_interval_us: 1",
            "firing_interval_us and firing_offsets_us exclude each other",
        ),
        ("firing_sequence_us: 20", "turns 0.072 degrees in a firing sequence of 20.0 us at 10.0"),
        (
            "firing_sequence_us: 55.6\nfiring_interval_us: 60",
            "2 lasers that fire at 0 to 60 us do not fit in the firing_sequence_us of 55.6",
        ),
        (
            "firing_sequence_us: 55.6\nfiring_offsets_us: [0, 55.6]",
            "2 lasers that fire at 0 to 55.6 us do not fit in the firing_sequence_us of 55.6",
        ),
        ("firing_sequence_us: 55.6\nfiring_offsets_us: [-1, 0]", "that fire at -1 to 0 us"),
        ("min_range_m: 30", "min_range_m 30.0 is not below max_range_m 30.0"),
        ("name: [", "not valid YAML"),
        (
            "min_range_m: 1\nmin_range_m: 2",
            "line 8: the key 'min_range_m' is repeated (see line 7)",
        ),
        ("max_range_m: 12:30", "max_range_m is '12:30', but must be a valid number"),
    ],
)
def test_a_wrong_entry_is_named_in_one_line(tmp_path: Path, change: str, fault: str) -> None:
    path = tmp_path / "bad.yaml"
    key, _, _ = change.partition(":")
    lines = [line for line in USERS_OWN.splitlines() if not line.startswith(f"{key}:")]
    path.write_text("\n".join([*lines, change]))
    with pytest.raises(InputError, match=r"bad\.yaml") as caught:
        load_sensor(path)
    assert fault in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_entry_a_missing_file_and_an_unknown_name_are_named(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    path.write_text("name: short\n")
    with pytest.raises(
        InputError, match=r"short\.yaml: the option 'laser_elevation_deg' is missing"
    ):
        load_sensor(path)
    path.write_text("- vlp16\n")
    with pytest.raises(InputError, match="expected names and values"):
        load_sensor(path)
    with pytest.raises(InputError, match="no such file"):
        load_sensor(tmp_path / "none.yaml")
    with pytest.raises(InputError, match=r"unknown sensor 'vlp17' \(known: .*vlp16"):
        load_sensor("vlp17")
