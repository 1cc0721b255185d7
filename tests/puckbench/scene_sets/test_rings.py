"""Returns recovered from frames of KITTI and nuScenes, which are written from known returns."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import Beams, Returns, read_firings, write_firings
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.turns import Layout, Turn
from puck.recordings.rings import _first_place, recovered_firings
from puckbench.codecs.registry import open_codec
from puckbench.scene_sets.kitti import Kitti
from puckbench.scene_sets.nuscenes import NuScenes
from puckbench.scene_sets.scene import Scene
from tests.support.codecs import decode_cloud, encode_returns
from tests.support.files import put
from tests.support.kitti_frames import as_kitti, hdl64


def of_kitti(folder: Path, data: bytes) -> Scene:
    put(folder / "training" / "velodyne" / "000000.bin", data)
    return Kitti(path=str(folder), returns=True).load("training_000000")


def test_the_lasers_of_kitti_s_frames_are_found_from_points(tmp_path: Path) -> None:
    original = hdl64()
    scene = of_kitti(tmp_path, as_kitti(original))
    assert Kitti(path=str(tmp_path), returns=True).of_returns
    assert not Kitti(path=str(tmp_path)).of_returns
    result = scene.returns
    assert result is not None
    assert len(result) == len(original)
    assert scene.about["points_left_out"] == 0
    assert scene.about["moved_most_mm"] < 2  # half a step of the range, and of coordinates
    lasers = np.argsort(result.beams.elevations_deg)
    for name, tolerance in (("elevations_deg", 0.002), ("heights_mm", 0.3), ("sideways_mm", 0.3)):
        own = np.array(getattr(result.beams, name))[lasers]
        np.testing.assert_allclose(own, getattr(original.beams, name), atol=tolerance)
    turned = np.array(result.beams.azimuths_deg)[lasers] - original.beams.azimuths_deg
    # All of them are against an angle that only whole turns would tell.
    assert np.ptp(turned) < 0.005
    image = result.turns[0].ranges[0][:, lasers].astype(int)
    shift = round(float(turned.mean()) * 100 / 9)
    steps = (result.turns[0].azimuths.astype(int) // 9 + shift) % 4000
    assert sorted(steps.tolist()) == (original.turns[0].azimuths // 9).tolist()
    expected = original.turns[0].ranges[0].astype(int)
    rows = np.argsort(steps)
    assert np.abs(image[rows] - expected).max() <= 1


def test_a_ring_may_end_just_before_a_whole_turn(tmp_path: Path) -> None:
    """A small negative y is rounded to -0.0, so the point belongs to the ring that ends there."""
    table = np.frombuffer(as_kitti(hdl64(100)), "<f4").reshape(-1, 4).copy()
    last = table[-1]
    last[:2] = [np.hypot(last[0], last[1]), -0.0]
    assert of_kitti(tmp_path, table.tobytes()).returns is not None
    last[1] = 0.0
    with pytest.raises(InputError, match=r"000000\.bin: 65 rings, not 64"):
        of_kitti(tmp_path, table.tobytes())


def test_recovered_returns_survive_files_and_streams(tmp_path: Path) -> None:
    result = of_kitti(tmp_path, as_kitti(hdl64(100))).returns
    assert result is not None
    write_firings(tmp_path / "turn.parquet", result)
    again = read_firings(tmp_path / "turn.parquet")
    assert again.beams == result.beams
    decoded = decode_cloud(open_codec("puck"), encode_returns(open_codec("puck"), result, "2mm"))
    np.testing.assert_array_equal(decoded.xyz, result.points())


@pytest.mark.parametrize("order", ["shuffled", "cut"])
def test_frames_in_another_order_are_refused(tmp_path: Path, order: str) -> None:
    table = np.frombuffer(as_kitti(hdl64(60)), "<f4").reshape(-1, 4)
    rows = np.random.default_rng(0).permutation(len(table)) if order == "shuffled" else slice(2000)
    with pytest.raises(InputError, match=r"000000\.bin: \d+ rings, not 64"):
        of_kitti(tmp_path, table[rows].tobytes())


def test_frames_that_no_sensor_measures_are_refused(tmp_path: Path) -> None:
    table = np.frombuffer(as_kitti(hdl64(60)), "<f4").reshape(-1, 4)
    with pytest.raises(InputError, match=r"000000\.bin: no point is within 131 m"):
        of_kitti(tmp_path, (100 * table).astype("<f4").tobytes())
    with pytest.raises(InputError, match=r"000000\.bin: a ring of fewer than 16 points"):
        of_kitti(
            tmp_path, (0 * table + [1e-3, 1e-3, 1, 0] * np.sign(table)).astype("<f4").tobytes()
        )


MOVED = np.array([-0.05, -0.45, -0.015])
ROLLED = np.array([0.002, -0.001])


def hdl32(columns: int = 120) -> Returns:
    """A turn of an HDL-32E whose lasers stand at angles of their own."""
    random = np.random.default_rng(4)
    elevations = sorted(load_sensor("hdl32e").laser_elevation_deg)
    turned = tuple(np.linspace(0, 0.25, 32).tolist())
    beams = Beams(tuple(elevations), (0.0,) * 32, (0.0,) * 32, azimuths_deg=turned)
    ranges = random.integers(1500, 20_000, (1, columns, 32)).astype(np.uint16)
    ranges[random.random(ranges.shape) < 0.2] = 0
    azimuths = (26_200 + np.arange(columns) * 36_000 // columns) % 36_000
    turn = Turn(ranges, azimuths.astype(np.uint16))
    return Returns(beams, Layout(tuple(range(32))), (turn,), 0.002, "HDL-32E")


def as_nuscenes(returns: Returns) -> Floats:
    """The file's rows: all firings, in the sensor's frame at the end of the turn."""
    ranges = returns.turns[0].ranges[0]
    columns = len(ranges)
    xyz = np.zeros((columns, 32, 3))
    xyz[ranges > 0] = returns.points()
    left = 1 - np.arange(columns)[:, None] / (columns - 1)
    xyz[..., 2] += left * (xyz[..., :2] @ ROLLED)
    xyz += (left * MOVED)[:, None]
    rings = np.broadcast_to(np.arange(32.0)[:, None], (columns, 32, 1))
    return np.concatenate([xyz, np.zeros_like(rings), rings], axis=2).reshape(-1, 5)


def of_nuscenes(folder: Path, rows: Floats, returns: bool = True) -> Scene:
    name = "n015-2018__LIDAR_TOP__1532402927.pcd.bin"
    put(folder / "samples" / "LIDAR_TOP" / name, rows.astype("<f4").tobytes())
    sweeps = NuScenes(path=str(folder), returns=returns)
    assert sweeps.names() == ["samples_n015-2018_1532402927"]
    return sweeps.load(sweeps.names()[0])


def test_the_motion_of_nuscenes_sweeps_is_undone(tmp_path: Path) -> None:
    original = hdl32()
    scene = of_nuscenes(tmp_path, as_nuscenes(original))
    result = scene.returns
    assert result is not None
    assert scene.group == "n015-2018"
    assert ((result.turns[0].ranges > 0) == (original.turns[0].ranges > 0)).all()
    apart = result.turns[0].ranges.astype(int) - original.turns[0].ranges.astype(int)
    assert np.abs(apart).max() <= 1
    np.testing.assert_allclose(
        result.beams.elevations_deg, original.beams.elevations_deg, atol=0.003
    )
    assert np.linalg.norm(result.points() - original.points(), axis=1).max() < 0.01
    assert scene.about["moved_rms_mm"] < 4


def firings(returns: Returns) -> Floats:
    """The points of a sweep as they are fired, (columns, 32, 3)."""
    return as_nuscenes(returns)[:, :3].reshape(-1, 32, 3)


@pytest.mark.parametrize(
    ("alike", "columns", "moved", "is_found"),
    [(3, 16, 3.9, True), (2, 16, 3.9, False), (3, 15, 3.9, False), (3, 16, 4.1, False)],
)
def test_the_way_is_known_from_three_alike_in_sixteen_columns_up_to_four_metres(
    alike: int, columns: int, moved: float, is_found: bool
) -> None:
    """Firings without a return, on a straight way that ends at 0."""
    left = 1 - np.arange(40) / 39
    place = np.array([0.6, 0.8, 0.0]) * moved
    xyz = np.random.default_rng(6).uniform(-9, 9, (40, 32, 3))
    xyz[:columns, 5 : 5 + alike] = (left[:columns, None] * place)[:, None]
    expected = place if is_found else np.zeros(3)
    assert _first_place(xyz, left) == pytest.approx(expected, abs=1e-4)


def test_heights_of_lasers_are_told_from_the_way_of_the_car() -> None:
    """Each laser starts at a height of its own, as those of other sensors do."""
    original = hdl32()
    heights = tuple(np.linspace(5, 45, 32).tolist())
    original = replace(original, beams=replace(original.beams, heights_mm=heights))
    result = recovered_firings(firings(original), "HDL-32E").returns
    np.testing.assert_allclose(result.beams.heights_mm, heights, atol=1.0)
    np.testing.assert_allclose(
        result.beams.elevations_deg, original.beams.elevations_deg, atol=0.003
    )


def with_few(returns: int) -> Returns:
    """A turn in which laser 4 has so many returns, and one column has three."""
    original = hdl32()
    ranges = original.turns[0].ranges
    ranges[0, :20, 16] = 6000  # others are told against the laser in the middle
    ranges[0, :, 4] = np.where(np.arange(120) < returns, 5000, 0)
    ranges[0, 30, 3:] = 0
    return original


def test_a_laser_is_found_from_sixteen_returns() -> None:
    original = with_few(16)
    result = recovered_firings(firings(original), "HDL-32E").returns
    assert ((result.turns[0].ranges > 0) == (original.turns[0].ranges > 0)).all()
    with pytest.raises(InputError, match="a laser with fewer than 16 returns"):
        recovered_firings(firings(with_few(15)), "HDL-32E")


def test_a_laser_that_never_returns_when_the_others_do_is_not_found() -> None:
    original = with_few(50)
    original.turns[0].ranges[0, 15:50, 16] = 0
    with pytest.raises(InputError, match="a laser that rarely returns when the others do"):
        recovered_firings(firings(original), "HDL-32E")


def test_sweeps_are_clouds_of_their_points_unless_returns_are_wanted(tmp_path: Path) -> None:
    rows = as_nuscenes(hdl32(40))
    rows[5, 0] = np.nan
    scene = of_nuscenes(tmp_path, rows, returns=False)
    assert scene.cloud is not None
    missing = np.count_nonzero(hdl32(40).turns[0].ranges == 0)
    assert scene.about["missing_returns"] in (missing, missing - 1)  # one may be that of nan
    assert scene.about["dropped_points"] == scene.about["missing_returns"] + 1
    assert len(scene.cloud) == len(rows) - scene.about["dropped_points"]
    with pytest.raises(InputError, match=r"bin: points are not in the order of 32 rings"):
        of_nuscenes(tmp_path, rows)


def test_firings_without_return_are_left_out_wherever_the_car_was(tmp_path: Path) -> None:
    original = hdl32(120)
    scene = of_nuscenes(tmp_path, as_nuscenes(original), returns=False)
    assert scene.cloud is not None
    ranges = original.turns[0].ranges
    assert scene.about["missing_returns"] == np.count_nonzero(ranges == 0)
    assert len(scene.cloud) == np.count_nonzero(ranges)
    sweeps = NuScenes(path=str(tmp_path), keep_missing=True)
    kept = sweeps.load(sweeps.names()[0]).cloud
    assert kept is not None
    assert len(kept) == ranges.size


def test_sweeps_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such folder .expected nuScenes"):
        NuScenes(path=str(tmp_path / "none")).names()
    with pytest.raises(InputError, match=r"no sweeps .samples/LIDAR_TOP"):
        NuScenes(path=str(tmp_path)).names()
    rows = as_nuscenes(hdl32(40))
    with pytest.raises(InputError, match=r"bin: points are not in the order of 32 rings"):
        of_nuscenes(tmp_path, rows[[1, 0, *range(2, len(rows))]])
    put(tmp_path / "samples" / "LIDAR_TOP" / "n015-2018__LIDAR_TOP__1532402927.pcd.bin", b"\0" * 30)
    sweeps = NuScenes(path=str(tmp_path))
    with pytest.raises(InputError, match=r"bin: truncated: 30 bytes are not whole points of 20"):
        sweeps.load(sweeps.names()[0])
