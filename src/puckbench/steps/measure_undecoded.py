from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cloud_files.poses import tum_bytes
from puckbench.metrics.task_registry import TASKS
from puckbench.recordings.drives import AZIMUTH, KEPT, NONE, Drive, read_drive
from puckbench.steps.measure_drive import TaskStep, write_task_results
from puckbench.steps.step import STEPS, PlannedStep, planned
from puckbench.tables.registry import UNDECODED

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = ("puckbench.steps.measure_drive",)

_RATES = {KEPT: "times", AZIMUTH: "azimuth times", NONE: "no times"}
"""What stands for the rate in the rows of results, by kind of times."""


@STEPS.register("measure_undecoded")
class MeasureUndecoded(TaskStep):
    """Measure a robot's tasks on the original turns of a drive."""

    @classmethod
    def of_plan(cls, flow: Workflow, /, drives: str, drive: str) -> PlannedStep:
        tasks = flow.plan.drives[drives].tasks
        return planned(
            cls(dataset=drives, tasks=tasks),
            {"drive": flow.files.drive(drives, drive)},
            *map(TASKS.module_of, tasks),
            memory_mb=2000,
            minutes=30,
        )

    def run(self, drive: Path, rows: Path, trajectories: Path) -> dict[str, Any]:
        """Write a row of results for each kind of times, and the files that tasks make.

        Parameters
        ----------
        drive
            The original drive.
        rows
            File for the rows (Parquet).
        trajectories
            Folder for the files of tasks, such as ``kept_kiss_icp.tum``, and for the poses of the
            drive at the middle and the end of each turn (``reference.tum``).
        """
        original = read_drive(drive)
        record = {"codec": UNDECODED, "rate": ""}
        results = list(self.rows(original, original.turns, record, drive.stem))
        named = [{**row, "rate": _RATES[row["times"]]} for row in results]
        write_task_results(rows, trajectories, named, {"reference.tum": _reference(original)})
        return {"rates": len(results)}


def _reference(drive: Drive) -> bytes:
    shares = (0.5, 1.0) if drive.turn_s > 0 else (0.5,)
    times = np.concatenate([drive.starts + share * drive.turn_s for share in shares])
    poses = np.concatenate([drive.poses_at(share) for share in shares])
    order = np.argsort(times)
    return tum_bytes(times[order], poses[order])
