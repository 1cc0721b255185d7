"""Drives of packet captures and of bags of clouds: references, times and files of poses."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cloud_files.poses import read_poses, tum_bytes
from pointkit.errors import InputError
from puckbench.recordings.drives import TURN_SHARE, UNDECODED_POSES, Drive, read_drive, shares_of
from puckbench.results.row_files import read_rows
from puckbench.steps.drive_of_clouds import DriveOfClouds
from puckbench.steps.encode_drive import EncodeDrive
from puckbench.steps.measure_drive import MeasureDrive
from puckbench.steps.measure_undecoded import MeasureUndecoded
from tests.support import cloud_turns
from tests.support.spinning import pcap, rows, spin

TURNS = 5
PACKET_S = 1327e-6
BEGUN_S = 1.6e9
"""When the capture's first packet was received, as `pcap` has it."""
METHODS = ("kiss_icp", "gicp")
TASKS = {"odometry": {"max_range_m": 20}, "gicp_odometry": {"max_range_m": 20}}


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Turns of a VLP-16 at rest, 18.75 packets each, over which the sensor's hour begins anew."""
    file = tmp_path_factory.mktemp("recorded") / "room.pcap"
    file.write_bytes(pcap(rows(spin(packets=140, seed=4))))
    return file


def made(recording: Path, poses: Path | None = None, loader: str = "recordings") -> Drive:
    first = 1 if loader == "recordings" else 0
    step = DriveOfClouds(
        loader=loader,
        names=tuple(f"{recording.stem}_{first + turn:04d}" for turn in range(TURNS - 2 * first)),
        options={"path": str(recording)},
        poses=poses and str(poses),
        odometry=TASKS["odometry"],
    )
    step.run(recording.with_name("drive.zip"))
    return read_drive(recording.with_name("drive.zip"))


def way(times: np.ndarray) -> np.ndarray:
    """Poses of a sensor that moves by 8 m and turns by 20 degrees a second."""
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    since = times - BEGUN_S
    poses[:, :3, :3] = Rotation.from_euler("z", 20 * since[:, None], degrees=True).as_matrix()
    poses[:, 1, 3] = 8 * since
    return poses


def test_a_capture_without_poses_is_compared_with_odometry(capture: Path) -> None:
    """Poses hold at the ends of turns, and the motion before the first of them goes on."""
    drive = made(capture)
    assert drive.about["poses"] == UNDECODED_POSES
    assert drive.pose_times[0] < drive.starts[0]
    turn_s = 18.75 * PACKET_S
    assert drive.turn_s == pytest.approx(turn_s, abs=PACKET_S)
    begins = BEGUN_S + turn_s * np.arange(1, TURNS - 1)
    np.testing.assert_allclose(drive.starts, begins, atol=2 * PACKET_S)
    table, folder = capture.with_name("rows.parquet"), capture.with_name("trajectories")
    step = MeasureUndecoded(dataset="room", tasks=TASKS)
    step.run(capture.with_name("drive.zip"), table, folder)
    undecoded = read_rows([table])[0]
    assert (undecoded["ate_m"], undecoded["odometry_skip"]) == (pytest.approx(0, abs=1e-6), 1)
    kinds = itertools.product(("kept", "azimuth", "none"), METHODS)
    names = {"reference.tum", *(f"{times}_{method}.tum" for times, method in kinds)}
    assert {path.name for path in folder.iterdir()} == names
    times, _ = read_poses(folder / "kept_kiss_icp.tum")
    reference, _ = read_poses(folder / "reference.tum")
    assert times is not None
    assert reference is not None
    np.testing.assert_allclose(times, drive.starts + drive.turn_s, atol=1e-6)
    np.testing.assert_allclose(reference[1::2], times, atol=1e-6)


@pytest.mark.parametrize("hertz", [20, 200])
def test_poses_of_another_rate_are_joined_by_their_times(capture: Path, hertz: int) -> None:
    times = BEGUN_S - 0.05 + np.arange(0.3 * hertz) / hertz
    file = capture.with_name("way.tum")
    file.write_bytes(tum_bytes(times, way(times)))
    drive = made(capture, file)
    middles = drive.starts + drive.turn_s / 2
    np.testing.assert_allclose(drive.poses_at(0.5), way(middles), atol=1e-4)
    assert len(drive.pose_times) < len(times)


def test_poses_that_do_not_cover_the_turns_are_refused(capture: Path) -> None:
    file = capture.with_name("way.tum")
    times = np.arange(9.0)
    file.write_bytes(tum_bytes(times, way(times + BEGUN_S)))
    fault = r"9 poses for 3 turns, poses from 0.000 to 8.000 s, turns from 1600000000.0"
    with pytest.raises(InputError, match=fault):
        made(capture, file)
    times = BEGUN_S + np.array([-3.0, -1.5, 1.5, 3.0])
    file.write_bytes(tum_bytes(times, way(times)))
    with pytest.raises(InputError, match=r"way.tum: no pose for 3 s after 1599999998.500 s"):
        made(capture, file)


def test_poses_without_times_that_fit_are_one_for_each_turn(capture: Path) -> None:
    file = capture.with_name("way.tum")
    poses = way(BEGUN_S + np.arange(3.0))
    file.write_bytes(tum_bytes(np.arange(3.0), poses))
    np.testing.assert_allclose(made(capture, file).poses_at(0.5), poses, atol=1e-8)


def test_clouds_of_a_bag_have_the_times_of_their_points(tmp_path: Path) -> None:
    bag = cloud_turns.bag(tmp_path / "way.mcap", cloud_turns.turns(TURNS))
    drive = made(bag, loader="recorded_clouds")
    begins = cloud_turns.STAMP_S + cloud_turns.TURN_S * np.arange(TURNS)
    np.testing.assert_allclose(drive.starts, begins, atol=1e-6)
    assert drive.turn_s == pytest.approx(cloud_turns.TURN_S)
    shares = cloud_turns.SINCE_S / cloud_turns.TURN_S
    for turn in drive.turns:
        np.testing.assert_allclose(shares_of(turn), shares, atol=1e-6)
    drive_file, curve, table = (tmp_path / name for name in ("drive.zip", "curve.zip", "rows"))
    changes = {"rates": {}, "metric_rates": {"50mm": {"step_m": 0.05}}}
    EncodeDrive(codec="draco", entry=changes, repeats=1).run(drive_file, curve)
    step = MeasureDrive(dataset="way", tasks=TASKS, codec="draco", entry=changes, repeats=1)
    step.run(drive_file, curve, table, tmp_path / "trajectories")
    assert [row["times"] for row in read_rows([table])] == ["azimuth", "none"]
    assert (tmp_path / "trajectories" / "50mm_azimuth_kiss_icp.tum").is_file()


def test_clouds_without_usable_times_have_those_of_their_stamps(tmp_path: Path) -> None:
    stamps_s = cloud_turns.STAMP_S + np.arange(TURNS) / 4
    clouds = cloud_turns.turns(TURNS, time=None)
    bag = cloud_turns.bag(tmp_path / "way.mcap", clouds, stamps_s.tolist())
    drive = made(bag, loader="recorded_clouds")
    np.testing.assert_allclose(drive.starts, stamps_s, atol=1e-6)
    assert drive.turn_s == 0
    assert TURN_SHARE not in drive.turns[0].fields
