from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from cloud_files.poses import read_lidar_poses
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import clock_steps
from pointkit.terminal import Progress
from puckbench.core.code import MESH_FILES, SENSOR
from puckbench.jobs.registry import JOBS, Job
from puckbench.jobs.scan import Scanning
from puckbench.recordings.drives import UNDECODED_POSES, Drive, check_times, turn_of, write_drive
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.scene import Scene
from virtual_lidar.sweep import Sweep

CODE = (
    *(*MESH_FILES, *SENSOR, "cloud_files.poses", "puckbench.scene_sets.scene"),
    *("puckbench.geometry.extent", "puckbench.jobs.scan", "puckbench.metrics.tasks.odometry"),
    "puckbench.recordings",
)

_TURN_S = 0.1
"""Assumed time (s) between the turns (revolutions) of a data set that has no times."""


@JOBS.register("drive")
class VirtualDrive(Scanning):
    """Scan a mesh from a moving virtual sensor.

    The result is a drive, i.e. consecutive turns (revolutions) of the sensor with its true poses.
    """

    def run(self, mesh: Path, drive: Path) -> dict[str, Any]:
        """Scan the file `mesh`, write the drive to `drive`, and return facts about it."""
        from virtual_lidar.scan_returns import returns_of_scan

        job, rng = self.scan_of(mesh)
        turns, sensor = [], job.sensor
        for portion in job.portions(rng, Progress("frame")):
            frames = portion["frame"]
            returns = returns_of_scan(portion).returns
            turns += [turn_of(each) for each in returns.split()][frames.min() : frames.max() + 1]
        times, poses = virtual_poses(job.sweep, np.asarray(job.origin))
        about = {"scene": mesh.stem, "seed": self.seed, "poses": "true"}
        about |= {"sensor": sensor.name, "error_model": self.errors}
        starts, turn_s = times[:-1:2], float(times[2] - times[0])
        made = Drive(tuple(turns), starts, turn_s, times, poses, about)
        write_drive(drive, made)
        return {**about, "turns": len(turns), "points": made.points}


def virtual_poses(sweep: Sweep, origin: Floats) -> tuple[Floats, Floats]:
    """Return times and poses of a moving virtual sensor, at the ends and middles of its turns.

    Parameters
    ----------
    sweep
        Motion of the sensor, with one turn (revolution) for each frame.
    origin
        Position (3,), m, that is added to the positions of the sweep's trajectory.

    Returns
    -------
    times
        Times (2 n + 1,) in s, for n turns.
    poses
        Poses (2 n + 1, 4, 4) that map sensor coordinates to the scene's, in m.
    """
    times = np.arange(2 * sweep.frames + 1) / (2 * sweep.frames_per_second)
    placed = sweep.poses_during(times)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = placed.rotations, placed.positions + origin
    return times, poses


@JOBS.register("drive_of_clouds")
class DriveOfClouds(Job):
    """Collect consecutive scenes of a scene set into a drive.

    A drive is a sequence of turns (revolutions) of a moving sensor with a pose in the middle of
    each. The poses are those of the file `poses`. Without a file, they are those of the scenes; if
    they have none, the odometry KISS-ICP estimates them from the undecoded turns. Such estimates
    are not the truth: errors of decoded turns are then deviations from the undecoded trajectory.

    Parameters
    ----------
    loader, options, seed
        Name of the loader of the clouds, its options, and its seed.
    names
        Names of the clouds in the order of time.
    poses
        File of poses in the format of TUM or KITTI.
    odometry
        Options of the task ``odometry``, with which KISS-ICP estimates poses.
    """

    loader: str
    names: tuple[str, ...]
    options: dict[str, Any] = Field({})
    poses: str | None = None
    odometry: dict[str, Any] = Field({})
    seed: int = 0

    def plugins(self) -> Iterable[str | None]:
        return (self.loader,)

    def run(self, drive: Path, clouds: tuple[Path, ...] = ()) -> dict[str, Any]:
        """Write the drive to the file `drive`, and return facts about it.

        The loader finds the files of the clouds itself; `clouds` only makes them known to
        Snakemake.
        """
        scenes = open_scene_set(self.loader, self.options, self.seed)
        loaded = [scenes.load(name) for name in self.names]
        made = self._drive(loaded)
        write_drive(drive, made)
        return {**made.about, "turns": len(made.turns), "points": made.points}

    def _drive(self, scenes: list[Scene]) -> Drive:
        turns = []
        for scene in scenes:
            if scene.cloud is None and scene.returns is None:
                raise InputError(f"scene {scene.name}: neither a cloud nor a sensor's returns")
            turns.append(turn_of(scene.returns) if scene.returns else scene.cloud)
        starts, is_moving = _starts(scenes)
        check_times(starts)
        turn_s = float(np.median(np.diff(starts))) if is_moving else 0.0
        poses, whose = self._poses(scenes)
        about = {"scene": scenes[0].group, "poses": whose, **_sensor(scenes[0])}
        clouds = tuple(turn for turn in turns if turn is not None)
        times = starts + turn_s / 2
        if poses is None:
            from puckbench.metrics.tasks.odometry import estimated_poses, moment_of, settings_of

            poses = estimated_poses(clouds, is_moving, *settings_of(**self.odometry))
            times = starts + moment_of(clouds) * turn_s
        last = poses[-1] @ np.linalg.inv(poses[-2]) @ poses[-1]  # goes on as it did
        times = np.append(times, 2 * times[-1] - times[-2])
        return Drive(clouds, starts, turn_s, times, np.concatenate([poses, [last]]), about)

    def _poses(self, scenes: list[Scene]) -> tuple[Floats | None, str]:
        if self.poses:
            poses = read_lidar_poses(Path(self.poses))
            if len(poses) != len(scenes):
                counts = f"{len(poses)} poses for {len(scenes)} turns"
                raise InputError(f"{self.poses}: {counts}: one for each turn is needed")
            if self.loader == "kitti" and self.options.get("returns"):
                axes = "returns of KITTI have other axes than its poses"
                raise InputError(f"poses: {axes}: put them where KITTI has them, poses/00.txt")
            return poses, Path(self.poses).name
        poses_of_scenes = [scene.pose for scene in scenes if scene.pose is not None]
        if len(poses_of_scenes) == len(scenes):
            return np.array(poses_of_scenes), "of the data set"
        return None, UNDECODED_POSES


def _sensor(scene: Scene) -> dict[str, Any]:
    return {"sensor": scene.about["sensor"]} if "sensor" in scene.about else {}


def _starts(scenes: list[Scene]) -> tuple[Floats, bool]:
    """Return the start times (n,) of n turns, in s, and whether their points have times too."""
    clocks = [scene.returns.turns[0].times for scene in scenes if scene.returns]
    if len(clocks) == len(scenes) and all(clock is not None for clock in clocks):
        begun = np.array([float(clock[0]) for clock in clocks if clock is not None])
        since_first = np.append(0.0, clock_steps(begun, HOUR_US)).cumsum()
        return np.asarray(since_first * 1e-6), True
    times = [scene.time_s for scene in scenes if scene.time_s is not None]
    if len(times) == len(scenes):
        return np.array(times), False
    return _TURN_S * np.arange(len(scenes), dtype=np.float64), False
