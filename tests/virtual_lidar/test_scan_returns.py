"""The returns of virtual scans, as their sensors would report them."""

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.turns import MAX_RANGE
from pointkit.seeding import generator
from tests.support.sensor_scenes import box
from virtual_lidar import ScanTable, open_error_model, open_sweep, scan
from virtual_lidar.scan_returns import returns_of_scan, true_points

ORIGIN = (0.3, -0.2, 1.1)


def _scan(errors: str = "vlp16", device: str = "vlp16", **sweep: object) -> ScanTable:
    """A turn in a room of 8 m by 6 m by 3 m."""
    settings = {"preset": "spin", **sweep}
    model = open_error_model(errors)
    mesh = box((-4, -3, 0), (8, 6, 3))
    sensor = load_sensor(device)
    return scan(mesh, sensor, open_sweep(settings), model, ORIGIN, generator(1, "test"))


def test_points_of_a_scan_are_where_it_measured_them() -> None:
    table = _scan()
    result = returns_of_scan(table)
    assert len(result.returns) == len(result.rows) == len(table)
    measured = table.xyz_noisy[result.rows] - ORIGIN
    off = np.linalg.norm(result.returns.points() - measured, axis=1)
    assert off.max() <= 0.001 + 1e-9  # half of the quantum of 2 mm; steps of 0.1 degrees are exact


def test_a_scan_with_firing_times_keeps_each_lasers_azimuth() -> None:
    table = _scan("none", timing="firing")
    result = returns_of_scan(table)
    measured = table.xyz_noisy[result.rows] - ORIGIN
    away = np.linalg.norm(measured, axis=1)
    off = np.linalg.norm(result.returns.points() - measured, axis=1)
    # Columns are reported in hundredths of a degree, every one of them and the next.
    assert (off <= 0.001 + np.radians(0.011) * away).all()
    assert np.abs(np.diff(result.returns.beams.delays) - 2.304 / 55.296).max() < 1e-9


@pytest.mark.parametrize("device", ["puck_hires", "hdl32e", "hdl64e_s2"])
@pytest.mark.parametrize(("timing", "most_deg"), [("together", 0.005), ("firing", 0.01)])
def test_points_of_every_sensor_are_where_it_reports_them(
    device: str, timing: str, most_deg: float
) -> None:
    """Ranges on the quantum, azimuths of columns in 0.01 degrees, as the sensors send them.

    A column's azimuth is off by half of that, and one between two columns by less than all of it.
    """
    turn = {"rotation_hz": 10, "frames_per_second": 10, "duration_s": 0.1}
    timed = {"timing": timing} if timing == "firing" else {}
    table = _scan("none", device, **turn, **timed)
    result = returns_of_scan(table)
    assert len(result.returns) == len(result.rows) == len(table)
    measured = table.xyz_noisy[result.rows] - ORIGIN
    points = result.returns.points()
    away = np.linalg.norm(measured, axis=1)
    off = np.linalg.norm(points - measured, axis=1)
    assert (off <= 0.001 + np.radians(most_deg) * away + 1e-9).all()
    yaw = [np.degrees(np.arctan2(each[:, 0], each[:, 1])) for each in (points, measured)]
    turned = np.mod(yaw[0] - yaw[1] + 180, 360) - 180
    assert np.abs(turned.mean()) < 1e-4  # rounded, not cut off: 0.005 degrees would be all of it
    assert set(table["laser_id"][result.rows]) == set(range(load_sensor(device).lasers))


def test_true_points_lie_on_the_walls() -> None:
    table = _scan()
    result = returns_of_scan(table)
    assert np.abs(true_points(table, result) - (table.xyz[result.rows] - ORIGIN)).max() < 1e-9
    assert result.still_at is not None
    np.testing.assert_allclose(result.still_at, ORIGIN)


def test_a_moving_sensor_has_its_own_frame() -> None:
    rows = [[0, 0, 0, 0, 0, 0, 0], [0.2, 1, 0, 0, 90, 0, 0]]
    table = _scan("none", trajectory=rows)
    result = returns_of_scan(table)
    assert result.still_at is None
    ranges = np.linalg.norm(true_points(table, result), axis=1)
    np.testing.assert_allclose(ranges, table["distance"][result.rows], rtol=1e-12)


def test_clean_ranges_can_be_taken() -> None:
    table = _scan()
    clean = returns_of_scan(table, clean=True)
    off = np.linalg.norm(clean.returns.points() - true_points(table, clean), axis=1)
    assert off.max() <= 0.001 + 1e-9


def test_ranges_that_16_bits_do_not_hold_are_left_out() -> None:
    """Whole steps of 2 mm from 1 to 65,535; 0 would mean that nothing returned."""
    table = _scan("none")
    distance = table["distance_noisy"].copy()
    distance[:4] = (0.0009, 0.0011, 65535 * 0.002, 65536 * 0.002)
    changed = ScanTable({**table.columns, "distance_noisy": distance}, table.about)
    result = returns_of_scan(changed)
    assert set(range(6)) - set(result.rows.tolist()) == {0, 3}
    ranges = np.concatenate([turn.ranges.ravel() for turn in result.returns.turns])
    assert ranges.max() == 65535
    assert len(result.returns) == len(result.rows) == len(table) - 2


@pytest.mark.parametrize(("known_mm", "step_m"), [(4.0, 0.004), (None, 0.002)])
def test_ranges_are_whole_steps_of_the_sensors_or_of_2_mm(
    known_mm: float | None, step_m: float
) -> None:
    table = _scan()
    sensor = {**table.about["sensor"], "range_quantum_mm": known_mm}
    result = returns_of_scan(ScanTable(table.columns, {**table.about, "sensor": sensor})).returns
    assert result.quantum_m == step_m
    ranges = np.concatenate([turn.ranges.ravel() for turn in result.turns])
    assert ranges.max() == round(table["distance_noisy"].max() / step_m)


def test_times_of_columns_are_the_scans_in_microseconds() -> None:
    table = _scan("none")
    (turn,) = returns_of_scan(table).returns.turns
    assert turn.times is not None
    last = table["timestamp"].max()
    assert turn.times.max() == pytest.approx(1e6 * last, abs=1)
    assert last > 0.19  # of 0.2 s


def test_frames_that_are_no_turns_are_refused() -> None:
    with pytest.raises(InputError, match="whole turns"):
        returns_of_scan(_scan(frames_per_second=10.0))


def test_scans_of_sensors_with_a_small_quantum_have_32_bits() -> None:
    sensor = Sensor(
        name="Far", laser_elevation_deg=(0.0, 1.0), rotation_hz=10.0, azimuth_step_deg=1.0,
        max_range_m=200.0, range_quantum_mm=1.0,
    )  # fmt: skip
    sweep = open_sweep(
        {"frames_per_second": 10.0, "duration_s": 0.1, "pitch_start_deg": 0, "pitch_end_deg": 0}
    )
    mesh = box((-80, -90, -20), (160, 180, 40))
    model, random = open_error_model("none"), np.random.default_rng(0)
    table = scan(mesh, sensor, sweep, model, (0.0, 0.0, 0.0), random)
    result = returns_of_scan(table).returns
    assert result.turns[0].ranges.dtype == np.uint32
    assert result.turns[0].ranges.max() == round(1000 * table["distance"].max()) > 0xFFFF
    distance = table["distance_noisy"].copy()
    distance[:2] = ((MAX_RANGE + 1) * 0.001, MAX_RANGE * 0.001)
    changed = returns_of_scan(ScanTable({**table.columns, "distance_noisy": distance}, table.about))
    assert len(changed.returns) == len(table) - 1
