from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.terminal import Progress
from puckbench.core.code import MESH_FILES, SENSOR
from puckbench.recordings.drives import Drive, turn_of, write_drive
from puckbench.steps.scan import Scanning
from puckbench.steps.step import STEPS, PlannedStep, planned
from virtual_lidar.sweep import Sweep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*MESH_FILES, *SENSOR, "cloud_files.poses", "puckbench.steps.scan"),
    "puckbench.recordings",
)


@STEPS.register("drive")
class VirtualDrive(Scanning):
    """Scan a mesh from a moving virtual sensor.

    The result is a drive, i.e. consecutive turns (revolutions) of the sensor with its true poses.
    """

    @classmethod
    def of_plan(cls, flow: Workflow, /, drives: str, drive: str) -> PlannedStep:
        entry = flow.drives.entries[drives]
        scene, seed = entry.scans[drive]
        settings = entry.settings.of_scene(scene)
        code, also = flow.plan.code_of_scan(settings)
        file = f"{flow.plan.results}/scenes/{entry.scenes.name}/{scene}"
        return planned(
            cls.of_entry(settings, scene, seed),
            {"scene": f"{file}.ply", "about": f"{file}.json"},
            *code.modules,
            content={"files": code.files},
            also=also,
            memory_mb=4000,
            minutes=30,
        )

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
