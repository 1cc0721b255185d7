from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import joined, moved, quad, room, wall
from virtual_lidar import (
    COLUMNS,
    ScanJob,
    ScanTable,
    Sweep,
    open_error_model,
    open_sweep,
    read_scan,
    scan,
    write_scan_portions,
)
from virtual_lidar.trajectory import read_rows, trajectory_from_rows

VLP16 = load_sensor("vlp16")
STILL = (0.0,) * 7


def scanned(mesh: Mesh, sweep: Sweep, origin: ArrayLike = (0, 0, 0), errors: str = "none") -> Any:
    model, rng = open_error_model(errors), np.random.default_rng(1)
    return scan(mesh, VLP16, sweep, model, list(np.asarray(origin)), rng)


def drive(*rows: tuple[float, ...], **changes: Any) -> Sweep:
    return open_sweep({"azimuth_step_deg": 1.0, "trajectory": rows, **changes})


def about(axis: str, degrees: Floats) -> Floats:
    """Rotations about an axis, written down, (n, 3, 3)."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    turned = np.zeros((len(degrees), 3, 3))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turned[:, i, i] = turned[:, j, j] = cosine
    turned[:, i, j], turned[:, j, i] = -sine, sine
    turned[:, "xyz".index(axis), "xyz".index(axis)] = 1
    return turned


def test_yaw_pitch_and_roll_turn_about_z_x_and_y_in_this_order() -> None:
    angles = np.random.default_rng(0).uniform(-80, 80, (20, 3))
    rows = [(i, 0, 0, 0, *map(float, turn)) for i, turn in enumerate(angles)]
    result = trajectory_from_rows(rows).at(np.arange(20.0)).rotations
    yaw, pitch, roll = angles.T
    assert result == pytest.approx(
        about("z", yaw) @ about("x", pitch) @ about("y", roll), abs=1e-12
    )


def test_turns_go_at_an_even_rate_along_the_shorter_arc() -> None:
    times = np.linspace(0, 1, 11)
    turn = trajectory_from_rows([STILL, (1, 0, 0, 0, 90, 0, 0)]).at(times)
    assert turn.rotations == pytest.approx(about("z", 90 * times), abs=1e-12)
    over = trajectory_from_rows([(0, 0, 0, 0, 170, 0, 0), (1, 0, 0, 0, -170, 0, 0)]).at(times)
    assert over.rotations == pytest.approx(about("z", 170 + 20 * times), abs=1e-12)


def test_positions_are_linear_in_time_between_the_rows() -> None:
    path = trajectory_from_rows([STILL, (1, 2, 0, 0, 0, 0, 0), (3, 2, 4, 0, 0, 0, 0)])
    places = path.at(np.array([0.25, 1.0, 2.5, 9.0])).positions
    assert places == pytest.approx(np.array([[0.5, 0, 0], [2, 0, 0], [2, 3, 0], [2, 4, 0]]))


def test_quaternions_are_taken_as_well() -> None:
    half = np.sqrt(0.5)
    path = trajectory_from_rows([(0, 0, 0, 0, half, 0, 0, half)])
    assert path.at(np.zeros(1)).rotations == pytest.approx(about("z", np.array([90.0])), abs=1e-12)


def test_a_trajectory_at_rest_scans_as_a_level_sweep_does() -> None:
    still = drive(STILL, duration_s=0.2)
    level = Sweep(duration_s=0.2, azimuth_step_deg=1.0, pitch_start_deg=0, pitch_end_deg=0)
    first, other = scanned(room(), still, (3, 2, 1)), scanned(room(), level, (3, 2, 1))
    assert all(np.array_equal(first[name], other[name]) for name in COLUMNS)


def test_a_moving_sensor_sees_a_wall_come_nearer_within_a_turn() -> None:
    """At 10 m/s towards a wall at 30 m the range along the normal is 30 - 10 t, ray by ray."""
    table = scanned(wall(30.0), drive(STILL, (1.0, 0, 10.0, 0, 0, 0, 0)))
    towards = table["distance"] * np.cos(table["incidence"])
    assert towards == pytest.approx(30 - 10 * table["timestamp"], abs=1e-9)
    assert table["y"] == pytest.approx(30, abs=1e-9)
    first_turn = towards[table["timestamp"] < 0.2]
    assert np.ptp(first_turn) > 1.5


def test_a_turning_sensor_adds_its_yaw_to_the_azimuth() -> None:
    table = scanned(room(), drive(STILL, (1.0, 0, 0, 0, 90, 0, 0)), (3, 2.5, 1.3))
    x, y, _ = (table.xyz - [3, 2.5, 1.3]).T
    expected = table["yaw"] + np.radians(90) * table["timestamp"]
    off = np.angle(np.exp(1j * (np.arctan2(-x, y) - expected)))
    assert off == pytest.approx(0, abs=1e-9)


def test_a_fixed_pose_is_one_row() -> None:
    table = scanned(wall(5.0), drive((0, 0, 2.0, 0, 0, 30, 0), duration_s=0.2))
    assert table["y"] == pytest.approx(5, abs=1e-9)
    ahead = table.select((np.abs(table["yaw"]) < 1e-9) & (table["laser_id"] == 1))
    assert ahead["distance"] == pytest.approx(3 / np.cos(np.radians(31)))


def test_positions_count_from_the_origin() -> None:
    far = np.array([100.0, -50.0, 3.0])
    moving = drive(STILL, (0.2, 1.0, 0.5, 0, 20, 0, 0))
    near = scanned(room(), moving, (2, 2, 1))
    away = scanned(moved(room(), far), moving, far + np.array([2, 2, 1]))
    assert away["distance"] == pytest.approx(near["distance"], abs=1e-9)
    assert away.xyz - far == pytest.approx(near.xyz, abs=1e-9)


@pytest.mark.parametrize("errors", ["vlp16", "surface_normal", "beam_footprint"])
def test_measured_points_of_a_moving_sensor_are_at_their_distance(errors: str) -> None:
    table = scanned(wall(8.0), drive(STILL, (0.5, 1.0, 2.0, 0, 0, 0, 0)), errors=errors)
    places = table["timestamp"][:, None] / 0.5 * [1.0, 2.0, 0.0]
    reach = np.linalg.norm(table.xyz_noisy - places, axis=1)
    assert reach == pytest.approx(table["distance_noisy"], abs=1e-9)


def test_a_sensor_beyond_the_origin_sees_what_is_hidden_from_there() -> None:
    screen = quad([-50, 2, -50], [100, 0, 0], [0, 0, 100])
    scene = joined([screen, wall(9.0)])
    table = scanned(scene, drive((0, 0, 5.0, 0, 0, 0, 0), duration_s=0.2))
    assert set(np.unique(table["y"].round(6))) == {2.0, 9.0}
    assert table["distance"].min() > 2.9


def test_portions_are_the_rows_of_the_whole_scan(tmp_path: Path) -> None:
    sweep = drive(STILL, (0.5, 1.0, 0.5, 0, 20, 0, 0))
    work = (room(skip=("+z",)), VLP16, sweep, open_error_model("vlp16"), (2, 2, 1))
    whole = scan(*work, np.random.default_rng(1))
    portions = list(ScanJob(*work).portions(np.random.default_rng(1), rays_in_a_portion=2000))
    assert len(portions) > 5
    rows = write_scan_portions(tmp_path / "scan.parquet", iter(portions))
    read = read_scan(tmp_path / "scan.parquet")
    assert rows == len(read) == len(whole)
    assert all(np.array_equal(read[name], whole[name]) for name in COLUMNS)
    assert read.about == whole.about


def test_a_stream_without_a_return_leaves_no_file(tmp_path: Path) -> None:
    job = ScanJob(room(), VLP16, Sweep(), open_error_model("none"), (900, 0, 0))
    portions = job.portions(np.random.default_rng(0))
    with pytest.raises(InputError, match="no ray returned"):
        write_scan_portions(tmp_path / "scan.parquet", portions)
    assert list(tmp_path.iterdir()) == []


def test_a_stream_that_fails_midway_leaves_no_file(tmp_path: Path) -> None:
    table: ScanTable = scanned(room(), drive(STILL, duration_s=0.1), (3, 2, 1))

    def failing() -> Any:
        yield table
        raise InputError("stopped")

    with pytest.raises(InputError, match="stopped"):
        write_scan_portions(tmp_path / "scan.parquet", failing())
    assert list(tmp_path.iterdir()) == []


ROWS = "0, 0, 0, 0, 0, 0, 0\n2, 1, 0, 0, 45, 0, 0\n"


def test_a_trajectory_comes_from_a_csv_or_yaml_file(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text("t,x,y,z,yaw,pitch,roll\n" + ROWS)
    (tmp_path / "way.yaml").write_text("".join(f"- [{row}]\n" for row in ROWS.splitlines()))
    sweeps = [open_sweep({"trajectory": str(tmp_path / name)}) for name in ("way.csv", "way.yaml")]
    assert sweeps[0] == sweeps[1]
    assert sweeps[0].duration_s == 2
    assert sweeps[0].trajectory == (STILL, (2, 1, 0, 0, 45, 0, 0))


@pytest.mark.parametrize(
    ("rows", "fault"),
    [
        ([], "trajectory needs rows of t, x, y, z, yaw, pitch, roll or"),
        ([[0, 1, 2]], "trajectory needs rows of"),
        ([STILL, (1, *STILL[1:]), (1, *STILL[1:])], "times that do not increase"),
        ([[0, 0, 0, 0, 1, 1, 0, 0]], "a quaternion that is not of length 1"),
        ([STILL, [1, 0, 0, "up", 0, 0, 0]], "trajectory.1.3 is 'up', but must be a valid number"),
        (5, "trajectory is 5, but must be a list"),
        ("nowhere.csv", "nowhere.csv: no such file"),
        ("bad.csv", "bad.csv: line 2 is not a row of numbers"),
        ("nan.csv", "nan.csv: line 1 has a number that is not finite"),
        ("bad.yaml", "bad.yaml: expected a list of poses"),
    ],
)
def test_a_wrong_trajectory_is_named_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: Any, fault: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.csv").write_text("0,0,0,0,0,0,0\n1,x,0,0,0,0,0\n")
    Path("nan.csv").write_text("0,0,0,0,0,0,nan\n")
    Path("bad.yaml").write_text("way: 5\n")
    with pytest.raises(InputError) as caught:
        open_sweep({"trajectory": rows})
    assert fault in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_sweep_does_not_outlast_its_trajectory() -> None:
    with pytest.raises(InputError, match=r"from 0 to 2 s, the sweep from 0 to 3 s"):
        drive(STILL, (2, 0, 0, 0, 0, 0, 0), duration_s=3)


CSV = {
    "heading": ("t,x,y,z,yaw,pitch,roll\n0,0,0,0,0,0,0\n1,2,0,0,0,0,0\n", [0, 1]),
    "mark": ("\ufeff5,0,0,0,0,0,0\n6,2,0,0,0,0,0\n", [5, 6]),
    "blank lines": ("\n5,0,0,0,0,0,0\n\n6,2,0,0,0,0,0\n\n", [5, 6]),
}


@pytest.mark.parametrize("name", CSV)
def test_poses_of_csv_files(tmp_path: Path, name: str) -> None:
    text, times = CSV[name]
    path = tmp_path / "way.CSV"
    path.write_text(text, encoding="utf-8")
    assert [row[0] for row in read_rows(path)] == times


def test_poses_of_yaml_files(tmp_path: Path) -> None:
    path = tmp_path / "way.yaml"
    path.write_text("- [0, 0, 0, 0, 0, 0, 0]\n- [1e1, 010, 0, 0, 0, 0, 0]\n")
    assert read_rows(path)[1] == (10, 10, 0, 0, 0, 0, 0)


WRONG = {
    "short.csv": ("0,0,0,0,0,0\n", "line 1 has 6 numbers"),
    "long.csv": ("0,0,0,0,0,0,0,1,2\n", "line 1 has 9 numbers"),
    "mixed.csv": ("t\n0,0,0,0,0,0,0\n1,0,0,0,1,0,0,0\n", "line 3 has 8 numbers"),
    "back.csv": ("0,0,0,0,0,0,0\n\n0,0,0,0,0,0,0\n", "line 3 is not later than the one before"),
    "half_heading.csv": ("0,0,zero,0,0,0,0\n", "line 1 is not a row of numbers"),
    "heading_alone.csv": ("t,x,y,z\n", "has no poses"),
    "field.csv": ("0," + "1" * 200_000, "line 1: not CSV"),
    "truth.yaml": ("- [0, 0, 0, 0, 0, 0, 0]\n- [1, true, 0, 0, 0, 0, 0]", "pose 2 is not a row"),
    "twice.yaml": ("a: 1\na: 2", "line 2: the key 'a' is repeated"),
    "flat.yaml": ("[1, 2]", "expected a list of poses"),
    "none.yaml": ("[]", "has no poses"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_of_poses_is_named_with_its_line(tmp_path: Path, name: str) -> None:
    text, fault = WRONG[name]
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_rows(path)
    assert str(caught.value).startswith(f"{path}: {fault}")
    assert "\n" not in str(caught.value)
