"""Motions by a few numbers: closed forms of their way, and what is refused."""

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.models import parsed
from virtual_lidar.sweep import open_sweep
from virtual_lidar.trajectory import Motion


def rows(**values: object) -> np.ndarray:
    return np.array(parsed(Motion, values, "motion").rows())


def test_sensor_rests_then_accelerates_to_its_speed() -> None:
    """0.5 s at rest, 2 s at 3 m/s2, then 6 m/s: 6 m and 6 m a second."""
    motion = rows(duration_s=5, speed_m_s=6, start=(1.0, 2.0))
    assert motion.shape == (101, 7)
    at = {time: motion[round(time / 0.05)] for time in (0.5, 2.5, 5.0)}
    assert at[0.5][1:3].tolist() == [1.0, 2.0]
    assert at[2.5][1] == pytest.approx(1 + 6.0, abs=0.02)
    assert at[5.0][1] == pytest.approx(1 + 6.0 + 15.0, abs=0.02)
    assert set(motion[:, 2]) == {2.0}
    assert set(motion[:, 4]) == {-90.0}  # the sensor looks along x


def test_bend_is_a_circle_and_swing_returns_to_the_middle() -> None:
    circle = rows(duration_s=20, speed_m_s=1, acceleration_m_s2=1e3, rest_s=0, bend_deg_per_m=57.3)
    radii = np.linalg.norm(circle[:, 1:3] - [0, 1.0], axis=1)
    np.testing.assert_allclose(radii, 1.0, atol=0.01)
    swing = rows(
        duration_s=10, speed_m_s=2, acceleration_m_s2=1e3, rest_s=0, swing_deg=20, swing_m=10
    )
    assert swing[0, 4] == pytest.approx(-70)
    assert abs(swing[100, 2]) < 0.01  # 10 m of the way: once to and fro
    assert np.abs(swing[:, 2]).max() > 0.5


def test_stop_and_go_stands_in_the_second_half_of_each_period() -> None:
    motion = rows(duration_s=8, speed_m_s=4, acceleration_m_s2=4, rest_s=0, stop_every_s=4)
    steps = np.diff(motion[:, 1]) / 0.05
    assert steps.max() == pytest.approx(4, abs=1e-6)
    standing = motion[1:, 0][steps < 1e-9]
    assert ((standing > 3) & (standing < 4.1)).any()
    assert ((standing > 7) & (standing < 8.1)).any()


def test_sweep_has_the_duration_of_its_motion() -> None:
    sweep = open_sweep({"preset": "spin", "trajectory": {"duration_s": 2, "speed_m_s": 3}})
    assert (sweep.duration_s, sweep.frames) == (2, 10)
    with pytest.raises(InputError, match=r"trajectory: .*speed_m_s"):
        open_sweep({"preset": "spin", "trajectory": {"duration_s": 2, "speed_m_s": -3}})
