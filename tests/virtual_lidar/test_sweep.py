from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.sensors import load_sensor
from virtual_lidar import Sweep, open_sweep
from virtual_lidar.sweep import ease

VLP16 = load_sensor("vlp16")


def blender_by_roots(time: float) -> float:
    """The Bezier of two automatic keys, its parameter found as a root of the cubic."""
    x1 = 1 / 2.5614
    x2 = 1 - x1
    roots = np.roots([1 + 3 * x1 - 3 * x2, 3 * x2 - 6 * x1, 3 * x1, -time])
    real = roots[np.abs(roots.imag) < 1e-9].real
    s = real[(real > -1e-9) & (real < 1 + 1e-9)][0]
    return 3 * s**2 * (1 - s) + s**3


def test_easing_is_blenders_default_bezier() -> None:
    times = np.linspace(0, 1, 41)
    assert ease(times) == pytest.approx([blender_by_roots(t) for t in times], abs=1e-12)


def test_easing_is_slow_in_slow_out() -> None:
    assert ease(np.array([0.0, 0.5, 1.0])) == pytest.approx([0, 0.5, 1], abs=1e-15)
    steps = np.diff(ease(np.linspace(0, 1, 1001)))
    assert steps[0] < 0.01 * steps[500]
    assert (np.diff(steps[:500]) > 0).all()
    assert (np.diff(steps[500:]) < 0).all()


def test_the_thesis_sweep_has_480_frames_of_2400_rays() -> None:
    sweep = Sweep()
    rays = sweep.rays(VLP16, range(sweep.frames))
    assert rays.yaw.shape == rays.pitch.shape == (480, 150, 16)
    assert rays.yaw.size == 1_152_000


def test_the_room_sweep_as_run_has_95_frames_of_13_888_rays() -> None:
    sweep = open_sweep("thesis_room")
    assert (sweep.frames, sweep.steps(VLP16) * VLP16.lasers) == (95, 13_888)
    assert sweep.max_range_m == 120


def test_pitch_is_keyed_in_the_first_and_the_last_frame() -> None:
    pitch = np.degrees(Sweep().pitch_rad())
    assert pitch[[0, -1]] == pytest.approx([-60, 60])
    assert pitch == pytest.approx(-pitch[::-1])


def test_a_frame_that_is_not_scanned_is_keyed_none_the_less() -> None:
    """0.29 s at 100 frames per second are 29 frames, of which the last is at time 1."""
    scanned = Sweep(duration_s=0.29, frames_per_second=100, frames_skipped=3)
    assert scanned.frames == 26
    eased = [blender_by_roots(frame / 28) for frame in range(26)]
    assert np.degrees(scanned.pitch_rad()) == pytest.approx(-60 + 120 * np.array(eased))
    single = Sweep(duration_s=0.01, frames_per_second=100)
    assert np.degrees(single.pitch_rad()) == pytest.approx([-60])


@pytest.mark.parametrize(
    ("options", "count"),
    [
        ({"frames_per_second": 100, "rotation_hz": 5, "azimuth_step_deg": 0.2}, 90),
        ({"frames_per_second": 100, "rotation_hz": 5, "azimuth_step_deg": 18 / 90.9}, 90),
        ({"frames_per_second": 100, "rotation_hz": 5, "azimuth_step_deg": 18}, 1),
        # 360 * 15 / 20 / 0.54 is a little below 500 in double precision.
        ({"frames_per_second": 20, "rotation_hz": 15, "azimuth_step_deg": 0.54}, 500),
    ],
)
def test_a_frame_has_the_whole_steps_of_its_share_of_a_turn(
    options: dict[str, float], count: int
) -> None:
    assert Sweep(**options).steps(VLP16) == count


def test_azimuth_and_time_run_on_from_frame_to_frame() -> None:
    sweep = Sweep()
    degrees = np.degrees(sweep.rays(VLP16, range(480)).yaw[:, :, 0].ravel())
    assert np.mod(degrees, 360) == pytest.approx(np.mod(0.1 * np.arange(72_000), 360), abs=1e-9)
    times = sweep.timestamps(VLP16, range(480)).ravel()
    assert times == pytest.approx(np.arange(72_000) / (5 * 3600), abs=1e-12)


def test_frames_can_be_taken_one_by_one() -> None:
    sweep = Sweep()
    whole = sweep.rays(VLP16, range(480))
    assert np.array_equal(sweep.rays(VLP16, range(77, 80)).yaw, whole.yaw[77:80])


def test_rotations_tilt_the_sensor_about_x() -> None:
    sweep = Sweep(duration_s=2 / 120, pitch_start_deg=-30, pitch_end_deg=90)
    down, up = sweep.rotations()
    forward = np.array([0.0, 1.0, 0.0])
    assert down @ forward == pytest.approx([0, np.sqrt(3) / 2, -0.5])
    assert up @ forward == pytest.approx([0, 0, 1], abs=1e-15)
    assert down @ [1, 0, 0] == pytest.approx([1, 0, 0])
    assert np.linalg.det(down) == pytest.approx(1)


def test_smaller_sweeps_by_configuration() -> None:
    sweep = open_sweep({"duration_s": 0.5, "azimuth_step_deg": 1})
    assert (sweep.frames, sweep.steps(VLP16)) == (60, 15)
    assert open_sweep({"preset": "thesis_room", "frames_skipped": 0}).frames == 96
    assert open_sweep({}) == open_sweep() == Sweep()


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ("fast", "unknown sweep 'fast' (known: thesis, thesis_room, spin)"),
        ({"fps": 3}, "sweep thesis: unknown option 'fps'"),
        ({"duration_s": "4 s"}, "duration_s is '4 s', but must be a valid number"),
        ({"frames_skipped": True}, "frames_skipped is True"),
        ({"duration_s": 0.001}, "the sweep has no frame"),
        ({"timing": "exact"}, "timing is 'exact', but must be 'step' or 'firing'"),
        (
            {"timing": "firing", "azimuth_step_deg": 0.2},
            "azimuth_step_deg is given, but timing 'firing' sets the step",
        ),
        ({"rotation_hz": -5}, "rotation_hz is -5, but must be greater than 0"),
    ],
)
def test_a_wrong_sweep_is_named_in_one_line(settings: Any, fault: str) -> None:
    with pytest.raises(InputError) as caught:
        open_sweep(settings)
    assert fault in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_frame_needs_an_azimuth_step() -> None:
    with pytest.raises(InputError, match=r"0\.75 azimuth steps"):
        Sweep(azimuth_step_deg=20).steps(VLP16)


def test_each_laser_fires_at_its_own_moment_and_azimuth() -> None:
    """The manual's times: 55.296 us a sequence, 2.304 us between lasers, 289,352 firings/s."""
    sweep = open_sweep({"preset": "spin", "timing": "firing"})
    times = sweep.firing_times(VLP16, range(1))
    assert np.diff(times[0], axis=1) == pytest.approx(2.304e-6)
    assert np.diff(times[0], axis=0) == pytest.approx(55.296e-6)
    assert times.size == pytest.approx(289_352 / 5, abs=16)
    rays = sweep.rays(VLP16, range(1))
    assert rays.yaw == pytest.approx(2 * np.pi * 5 * times, abs=1e-9)


def test_lasers_fire_together_unless_asked_otherwise() -> None:
    times = Sweep().firing_times(VLP16, range(2))
    assert times.shape == (2, 150, 16)
    assert np.ptp(times, axis=2).max() == 0
    assert np.array_equal(times[:, :, 0], Sweep().timestamps(VLP16, range(2)))


def test_a_spin_is_one_level_turn() -> None:
    spin = open_sweep("spin")
    yaw = spin.rays(VLP16, range(spin.frames)).yaw[0, :, 0]
    assert np.degrees(yaw) == pytest.approx(np.arange(3600) * 0.1, abs=1e-9)
    assert np.array_equal(spin.rotations(), [np.eye(3)])


def test_lasers_of_both_blocks_of_the_hdl64e_fire_in_unison() -> None:
    sweep = open_sweep({"preset": "spin", "timing": "firing"})
    sensor = load_sensor("hdl64e_s2")
    times = sweep.firing_times(sensor, range(1))[0]
    assert np.array_equal(times[:, :32], times[:, 32:])
    # From one four of the upper block to the next, and from one sequence to the next.
    assert times[0, 4:32:4] - times[0, 0:28:4] == pytest.approx(np.full(7, 6e-6))
    assert np.diff(times[:, 0]) == pytest.approx(48e-6)
    rays = sweep.rays(sensor, range(1))
    assert rays.yaw[0] == pytest.approx(2 * np.pi * 5 * times, abs=1e-9)


def test_firing_needs_a_sensor_that_states_its_times() -> None:
    sweep = open_sweep({"preset": "spin", "timing": "firing"})
    silent = VLP16.replaced(firing_interval_us=None)
    with pytest.raises(InputError, match="VLP-16 does not state when its lasers fire"):
        sweep.rays(silent, range(1))
    with pytest.raises(InputError, match="VLP-16 does not state its firing_sequence_us"):
        sweep.rays(silent.replaced(firing_sequence_us=None), range(1))


def test_a_sensor_that_stays_has_one_place_and_a_pose_for_each_step() -> None:
    times, places = Sweep().way()
    assert times.tolist() == [0]
    assert places.tolist() == [[0, 0, 0]]
    poses = Sweep().poses(VLP16, range(2))
    assert poses.rotations.shape == (2, 150, 3, 3)
    assert poses.positions.shape == (2, 150, 3)
    assert not poses.positions.any()


def test_a_moving_sensor_goes_straight_between_the_poses_of_its_sweep() -> None:
    rows = [(float(t), float(t**2), 0.0, 1.0, 0.0, 0.0, 0.0) for t in (0, 1, 2, 3)]
    times, places = open_sweep({"trajectory": rows, "duration_s": 2.5}).way()
    assert times.tolist() == [0, 1, 2, 2.5]
    assert places.tolist() == [[0, 0, 1], [1, 0, 1], [4, 0, 1], [6.5, 0, 1]]
    assert open_sweep({"trajectory": rows}).duration_s == 3
    fixed = open_sweep({"trajectory": rows[:1], "duration_s": 1.0}).way()
    assert [values.tolist() for values in fixed] == [[0], [[0, 0, 1]]]
