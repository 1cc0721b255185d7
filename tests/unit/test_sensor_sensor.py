from pathlib import Path

import numpy as np
import pytest

from puckbench.errors import InputError
from puckbench.sensor import load_sensor, sensor_names

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


def test_every_shipped_sensor_loads() -> None:
    assert [load_sensor(name).lasers > 0 for name in sensor_names()]


def test_a_users_own_sensor_is_a_yaml_file(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(USERS_OWN)
    sensor = load_sensor(path)
    assert (sensor.name, sensor.lasers, sensor.min_range_m) == ("two lasers", 2, 0.0)
    assert load_sensor(str(path)) == sensor


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ("elevation_deg: 3", "unknown option 'elevation_deg'"),
        ("rotation_hz: fast", "rotation_hz is 'fast', but must be a finite number"),
        ("rotation_hz: .inf", "rotation_hz is inf"),
        ("rotation_hz: 0", "rotation_hz is 0.0, but must be greater than 0"),
        ("laser_elevation_deg: 3", "must be a list of numbers"),
        ("laser_elevation_deg: []", "laser_elevation_deg is empty"),
        ("laser_elevation_deg: [-1, 91]", "beyond 90 degrees"),
        ("vertical_correction_mm: [1]", "1 vertical_correction_mm for 2 lasers"),
        ("min_range_m: 40", "min_range_m 40.0 is not below max_range_m 30.0"),
        ("min_range_m: -1", "min_range_m is -1.0, but must be at least 0"),
        ("name: 5", "name is 5, but must be of type str"),
        ("name: [", "not valid YAML"),
    ],
)
def test_a_wrong_entry_is_named_in_one_line(tmp_path: Path, change: str, fault: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(USERS_OWN + change + "\n")
    with pytest.raises(InputError, match=r"bad\.yaml") as caught:
        load_sensor(path)
    assert fault in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_entry_a_missing_file_and_an_unknown_name_are_named(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    path.write_text("name: short\n")
    with pytest.raises(InputError, match="missing 4 required positional arguments: 'laser_elev"):
        load_sensor(path)
    path.write_text("- vlp16\n")
    with pytest.raises(InputError, match="expected names and values"):
        load_sensor(path)
    with pytest.raises(InputError, match="no such file"):
        load_sensor(tmp_path / "none.yaml")
    with pytest.raises(InputError, match=r"unknown sensor 'vlp17' \(known: .*vlp16"):
        load_sensor("vlp17")
