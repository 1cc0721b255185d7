"""The sensor as G-PCC's parameter sets describe it."""

from dataclasses import replace

import numpy as np
import pytest

from gpcc.coder import encode_geometry
from gpcc.options import PROFILES, SPINNING
from gpcc.sensor import SensorDescription, describe_sensor
from gpcc.syntax import Laser
from pointkit.errors import InputError
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.sensor import load_sensor
from pointkit.lidar.turns import Layout, Turn

# Tangents and heights in mm of the VLP-16's lasers upwards, as given to TMC13, and what it wrote.
TANGENTS = (-0.267949, -0.230868, -0.194380, -0.158384, -0.122785, -0.087489, -0.052408, -0.017455)
HEIGHTS = (11.2, 9.7, 8.1, 6.6, 5.1, 3.7, 2.2, 0.7)
THETAS = (-70241, -60521, -50956, -41519, -32187, -22935, -13738, -4576)
ZS = (-90, -78, -65, -53, -41, -30, -18, -6)


def test_lasers_are_those_that_tmc13_writes() -> None:
    sensor = SensorDescription(
        (*TANGENTS, *(-t for t in TANGENTS)), (*HEIGHTS, *(-h for h in HEIGHTS)), 1809
    )
    lower = [Laser(theta, z, 1809) for theta, z in zip(THETAS, ZS, strict=True)]
    upper = [Laser(-laser.theta, -laser.z, 1809) for laser in reversed(lower)]
    assert sensor.lasers() == lower + upper


def test_a_data_sheet_gives_the_same_lasers_upwards() -> None:
    beams = Beams.of(load_sensor("vlp16"))
    lasers = describe_sensor(beams, 0.001, 3600).lasers()
    assert [laser.z for laser in lasers[:8]] == list(ZS)
    # TMC13 was given tangents of six decimals.
    assert np.abs(np.subtract([laser.theta for laser in lasers[:8]], THETAS)).max() <= 1
    assert {laser.num_phi_per_turn for laser in lasers} == {3600}
    coarse = describe_sensor(beams, 0.002, 1809).lasers()
    assert coarse[0].z == -45
    assert coarse[0].num_phi_per_turn == 1809


def _hdl64e() -> Beams:
    """Two blocks of 32 lasers, whose beams cross the axis 0.12 and 0.21 m above the origin."""
    elevations = np.concatenate([np.linspace(-24.8, -8.9, 32), np.linspace(-8.5, 2.0, 32)])
    heights = np.repeat([120.0, 210.0], 32)
    return Beams(tuple(elevations.tolist()), tuple(heights.tolist()), (0.0,) * 64)


def test_the_head_is_where_the_upper_beams_cross_the_axis() -> None:
    """To 50 mm, in steps of the grid; VLP-16's and HDL-32E's cross it at their origin."""
    for unit_m, raised, heights in ((0.001, 200, (-80, 10)), (0.002, 100, (-40, 5))):
        sensor = describe_sensor(_hdl64e(), unit_m, 4000, (7, -5, 30))
        assert sensor.position == (7, -5, 30 + raised)
        assert sensor.height[::63] == pytest.approx(heights)
    for name in ("vlp16", "hdl32e", "puck_hires"):
        other = describe_sensor(Beams.of(load_sensor(name)), 0.001, 1800, (7, -5, 30))
        assert other.position == (7, -5, 30)


def test_an_octree_takes_fewer_bits_from_the_raised_head() -> None:
    """A node's laser is found by its angle from the head: as with KITTI's frame (13 %)."""
    raised = describe_sensor(_hdl64e(), 0.001, 360)
    low = SensorDescription(
        raised.tan_elevation, tuple(height + 200 for height in raised.height), 360
    )
    azimuth, laser = np.divmod(np.arange(360 * 64), 64)
    angle = np.radians(azimuth)
    noise = np.random.default_rng(2).normal(0, 20, len(angle))
    radius = 9000 + 3000 * np.sin(3 * angle) + noise
    z = np.array(low.height)[laser] + radius * np.array(low.tan_elevation)[laser]
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    grid = np.rint(points).astype(np.int64)
    options = PROFILES["ctc"].model_copy(update=SPINNING)
    sizes = [len(encode_geometry(grid, options, sensor=sensor)) for sensor in (raised, low)]
    assert sizes[0] < 0.95 * sizes[1]


def test_the_position_is_from_the_sequences_origin() -> None:
    elements = SensorDescription((0.0,), (0.0,), 100, (5, 6, -7)).syntax_elements((8, 6, -20))
    assert elements["gps_angular_origin_xyz"] == (-3, 0, 13)
    assert elements["gps_angular_origin_bits_minus1"] == 3


@pytest.mark.parametrize(
    ("tangents", "heights", "steps"),
    [((), (), 1), ((0.0,), (), 1), ((0.0,), (0.0,), 0), ((float("nan"),), (0.0,), 1)],
)
def test_what_no_stream_can_hold_is_refused(tangents: tuple, heights: tuple, steps: int) -> None:
    with pytest.raises(InputError, match="sensor"):
        SensorDescription(tangents, heights, steps)


def test_beams_that_start_beside_the_axis_cross_it_lower_or_higher() -> None:
    """A point at distance d is at the height and the radius that the description relates."""
    beams = Beams((30.0, -20.0), (5.0, 7.0), (0.0, 0.0), azimuths_deg=(4.0, -4.0))
    beams = replace(beams, radial_mm=(27.67, 27.67))
    sensor = describe_sensor(beams, 0.001, 1024)
    turn = Turn(np.full((1, 1, 2), 9000, np.uint32), np.zeros(1, np.uint16))
    layout = Layout((1, 0), azimuth_steps=1024)
    x, y, z = 1000 * Returns(beams, layout, (turn,), 0.001).points().T
    crossed = z - np.hypot(x, y) * np.array(sensor.tan_elevation) - sensor.position[2]
    np.testing.assert_allclose(crossed, sensor.height, atol=0.01)
