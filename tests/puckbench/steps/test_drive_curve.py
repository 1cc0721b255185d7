"""A drive on a winding way: coding as points loses no times, since azimuths give them."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cloud_files.meshes import write_mesh
from pointkit.geometry.cloud import PointCloud
from pointkit.models import parsed
from puckbench.metrics.tasks.odometry import estimated_poses
from puckbench.recordings.drives import (
    TURN_SHARE,
    Drive,
    azimuth_shares,
    firing_shares,
    read_drive,
)
from puckbench.results.row_files import read_rows
from puckbench.steps.drive import VirtualDrive
from puckbench.steps.encode_drive import EncodeDrive
from puckbench.steps.measure_drive import MeasureDrive
from puckbench.steps.measure_undecoded import MeasureUndecoded
from virtual_lidar.scenes.street import make_street, street_origin

TASKS = {"odometry": {"skip": 10}, "gicp_odometry": {"skip": 10}}
WINDING = {"duration_s": 5.5, "speed_m_s": 7, "start": [-16, 0], "swing_deg": 20, "swing_m": 18}
CHANGES = {"rates": {}, "metric_rates": {"100mm": {"step_m": 0.1}}}


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "street.ply"
    write_mesh(file, make_street("street_1", 3, 60.0))
    return file


def made_drive(street: Path, file: Path, motion: dict[str, Any]) -> Drive:
    spin = {"preset": "spin", "rotation_hz": 10, "frames_per_second": 10, "azimuth_step_deg": 0.5}
    settings = {"origin": street_origin(), "sweep": {**spin, "trajectory": motion}}
    parsed(VirtualDrive, {**settings, "errors": "vlp16"}, "drive").run(street, file)
    return read_drive(file)


@pytest.fixture(scope="module")
def drive(street: Path) -> Path:
    file = street.parent / "drive.zip"
    made_drive(street, file, WINDING)
    return file


def rows_of(drive: Path, curve: Path | None = None, codec: str | None = None) -> pd.DataFrame:
    rows, folder = drive.parent / "rows.parquet", drive.parent / "trajectories"
    if codec and curve:
        MeasureDrive(dataset="way", tasks=TASKS, codec=codec, entry=CHANGES, repeats=1).run(
            drive, curve, rows, folder
        )
    else:
        MeasureUndecoded(dataset="way", tasks=TASKS).run(drive, rows, folder)
    return pd.DataFrame(read_rows([rows])).set_index("times")


def test_azimuths_give_the_firing_times(drive: Path) -> None:
    for turn in read_drive(drive).turns[::20]:
        assert turn.returns is not None
        shares = firing_shares(turn.returns)
        np.testing.assert_allclose(azimuth_shares(turn.xyz, turn), shares, atol=1e-12)
        timed = PointCloud(turn.xyz, fields={TURN_SHARE: shares})
        np.testing.assert_allclose(azimuth_shares(turn.xyz, timed), shares, atol=2e-5)


def test_codecs_of_points_drift_as_far_as_the_undecoded_drive_with_times_of_azimuths(
    drive: Path,
) -> None:
    undecoded = rows_of(drive)
    assert undecoded["rate"].to_dict() == {
        "kept": "times",
        "azimuth": "azimuth times",
        "none": "no times",
    }
    EncodeDrive(codec="gpcc", entry=CHANGES, repeats=1).run(drive, drive.parent / "curve.zip")
    coded = rows_of(drive, drive.parent / "curve.zip", "gpcc")
    assert list(coded.index) == ["azimuth", "none"]
    for column in ("drift_percent", "gicp_drift_percent"):
        before = undecoded[column]
        assert before["azimuth"] == pytest.approx(before["kept"], rel=0.01)
        assert coded[column]["azimuth"] < 1.5 * before["kept"]
        assert coded[column]["none"] > 2 * before["kept"]
    assert (coded["lost_turns"] == 0).all()


def test_odometry_needs_some_turns_to_settle_if_the_first_is_in_motion(
    street: Path, tmp_path: Path
) -> None:
    """Deskewing with the last turn's velocity overshoots and swings, but not from rest."""
    swings = {}
    for name, motion in {"moving": {"rest_s": 0, "acceleration_m_s2": 1e4}, "rest": {}}.items():
        way = {"duration_s": 3, "speed_m_s": 9, "start": [-25, 0], **motion}
        drive = made_drive(street, tmp_path / f"{name}.zip", way)
        estimated = estimated_poses(drive.turns, True, 100.0, 1.0)
        steps = np.linalg.norm(np.diff(estimated[:, :3, 3], axis=0), axis=1)
        true = np.linalg.norm(np.diff(drive.poses_at(1.0)[:, :3, 3], axis=0), axis=1)
        swings[name] = np.abs(steps - true)
    assert swings["moving"][:8].max() > 0.3
    assert swings["moving"][-8:].max() < 0.1
    assert swings["rest"].max() < 0.15
