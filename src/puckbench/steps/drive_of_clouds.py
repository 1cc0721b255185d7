from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from cloud_files.poses import files_of_poses, read_lidar_poses
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import clock_steps
from puckbench.core.code import MESH_FILES, SENSOR
from puckbench.recordings.drives import UNDECODED_POSES, Drive, check_times, turn_of, write_drive
from puckbench.scene_sets.loader_code import loader_modules
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.scene import Scene
from puckbench.steps.scene import LoaderSettings
from puckbench.steps.step import STEPS, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*MESH_FILES, *SENSOR, "cloud_files.poses", "puckbench.scene_sets.scene"),
    *("puckbench.metrics.tasks.odometry", "puckbench.recordings"),
)

_TURN_S = 0.1
"""Assumed time (s) between the turns (revolutions) of a data set that has no times."""


@STEPS.register("drive_of_clouds")
class DriveOfClouds(LoaderSettings, Step):
    """Collect consecutive clouds of a data set into a drive.

    A drive is a sequence of turns (revolutions) of a moving sensor with a pose in the middle of
    each. The poses are those of the file `poses`. Without a file, they are those of the data set;
    if it has none, the odometry KISS-ICP estimates them from the undecoded turns. Such estimates
    are not the truth: errors of decoded turns are then deviations from the undecoded trajectory.

    Parameters
    ----------
    names
        Names of the clouds in the order of time.
    seed
        Seed of the loader.
    poses
        File of poses in the format of TUM or KITTI.
    odometry
        Options of the task ``odometry``, with which KISS-ICP estimates poses.
    """

    names: tuple[str, ...]
    seed: int = 0
    poses: str | None = None
    odometry: dict[str, Any] = Field({})

    @classmethod
    def of_plan(cls, flow: Workflow, /, drives: str, drive: str) -> PlannedStep:
        entry, plan = flow.drives.entries[drives], flow.plan
        scenes, poses = entry.scenes, entry.settings.poses
        step = cls(
            loader=scenes.loader,
            names=entry.clouds[drive],
            options=scenes.options,
            poses=poses,
            odometry=entry.settings.tasks.get("odometry", {}),
            seed=scenes.seed,
        )
        of_clouds = [file for name in step.names for file in scenes.files(name)]
        content = {
            "clouds": list(dict.fromkeys(of_clouds)),
            "poses": [str(file) for file in files_of_poses(poses)] if poses else [],
        }
        digest = plan.digest_of(file for files in content.values() for file in files)
        return planned(
            step,
            {},
            *loader_modules(scenes.loader, content["clouds"]),
            content=content,
            also=digest,
            memory_mb=4000,
            minutes=30,
        )

    def plugins(self) -> Iterable[str | None]:
        return (self.loader,)

    def run(self, drive: Path) -> dict[str, Any]:
        """Write the drive to the file `drive`, and return facts about it.

        The loader finds the files of the clouds.
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
