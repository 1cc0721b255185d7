from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from cloud_files.poses import files_of_poses
from pointkit.errors import InputError
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import elapsed
from puckbench.core.code import MESH_FILES, SENSOR
from puckbench.recordings.drive_poses import extended, poses_of_file
from puckbench.recordings.drives import UNDECODED_POSES, Drive, check_times, turn_of, write_drive
from puckbench.recordings.pose_axes import axes_from_turns
from puckbench.recordings.timed_clouds import TimedClouds, timed_clouds
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

_OF_ODOMETRY = ("odometry", "gicp_odometry")
_TURN_S = 0.1
"""Assumed time (s) between the turns (revolutions) of a data set that has no times."""


@STEPS.register("drive_of_clouds")
class DriveOfClouds(LoaderSettings, Step):
    """Collect consecutive scenes of a scene set into a drive.

    A drive is a sequence of turns (revolutions) of a moving sensor, with poses. The poses are those
    of the file `poses`. Without a file, they are those of the scenes; if they have none, the
    odometry KISS-ICP estimates them from the undecoded turns. Such estimates are not the truth:
    errors of decoded turns are then deviations from the undecoded trajectory.

    Poses of a file have times that cover those of the turns. Otherwise, there is one pose for each
    turn, which is that of its middle. If the turns show that the poses have other axes, turned by
    multiples of 90 degrees about z, such as those of ROS, the poses are converted, with a warning.

    Parameters
    ----------
    names
        Names of the clouds in the order of time.
    seed
        Seed of the loader.
    poses
        File of poses in the format of TUM or KITTI.
    odometry
        Options of the task on the drive (``odometry``, or else ``gicp_odometry``), with which
        KISS-ICP estimates poses.
    """

    names: tuple[str, ...]
    seed: int = 0
    poses: str | None = None
    odometry: dict[str, Any] = Field({})

    @classmethod
    def of_plan(cls, flow: Workflow, /, drives: str, drive: str) -> PlannedStep:
        entry, plan = flow.drives.entries[drives], flow.plan
        scenes, poses, tasks = entry.scenes, entry.settings.poses, entry.settings.tasks
        step = cls(
            loader=scenes.loader,
            names=entry.clouds[drive],
            options=scenes.options,
            poses=poses,
            odometry=next((tasks[name] for name in _OF_ODOMETRY if name in tasks), {}),
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
        clouds, starts, turn_s = _timed_turns(scenes)
        check_times(starts)
        whose = UNDECODED_POSES
        if self.poses:
            times, poses = poses_of_file(self.poses, starts, turn_s, are_known=_are_timed(scenes))
            whose = Path(self.poses).name
            if self.loader == "kitti" and self.options.get("returns"):
                axes = "returns of KITTI have other axes than its poses"
                raise InputError(f"poses: {axes}: put them where KITTI has them, poses/00.txt")
        elif all(scene.pose is not None for scene in scenes):
            times, poses = starts + turn_s / 2, np.array([scene.pose for scene in scenes])
            whose = "of the data set"
        else:
            from puckbench.metrics.tasks.odometry import estimated_poses, moment_of, settings_of

            poses = estimated_poses(clouds, turn_s > 0, *settings_of(**self.odometry))
            times = starts + moment_of(clouds) * turn_s
        about = {"scene": scenes[0].group, "poses": whose, **_sensor(scenes[0])}
        made = Drive(clouds, starts, turn_s, *extended(times, poses), about)
        return _with_axes_of_turns(made, self.poses) if self.poses else made


def _with_axes_of_turns(drive: Drive, path: str) -> Drive:
    """Return a drive whose poses, which are those of a file, have the axes of its turns."""
    poses = drive.poses_at(0.5)
    matrix, remark = axes_from_turns(path, poses, lambda number: drive.turns[number].xyz)
    about = {**drive.about, "poses": f"{drive.about['poses']}: {remark}"} if remark else drive.about
    return replace(drive, poses=drive.poses @ matrix, about=about)


def _sensor(scene: Scene) -> dict[str, Any]:
    return {"sensor": scene.about["sensor"]} if "sensor" in scene.about else {}


def _are_timed(scenes: Sequence[Scene]) -> bool:
    return all(scene.time_s is not None for scene in scenes)


def _timed_turns(scenes: Sequence[Scene]) -> TimedClouds:
    """Return the turns with their times; they last 0 s if their points have no times."""
    turns, clocks = [], []
    for scene in scenes:
        if scene.cloud is None and scene.returns is None:
            raise InputError(f"scene {scene.name}: neither a cloud nor a sensor's returns")
        if scene.returns is not None:
            turns.append(turn_of(scene.returns))
            clocks.append(scene.returns.turns[0].times)
        elif scene.cloud is not None:
            turns.append(scene.cloud)
    times = [scene.time_s for scene in scenes if scene.time_s is not None]
    begun_us = [float(clock[0]) for clock in clocks if clock is not None]
    if len(begun_us) == len(scenes):
        since_first = elapsed(np.array(begun_us), HOUR_US) * 1e-6
        turn_s = float(np.median(np.diff(since_first)))
        return TimedClouds(tuple(turns), (times or [0.0])[0] + since_first, turn_s)
    stamps_s = np.array(times if len(times) == len(scenes) else _TURN_S * np.arange(len(scenes)))
    timed = None if clocks else timed_clouds(turns, stamps_s, scenes[0].group)
    return timed or TimedClouds(tuple(turns), stamps_s, 0.0)
