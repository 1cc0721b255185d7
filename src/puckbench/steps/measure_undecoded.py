from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.metrics.task_registry import TASKS
from puckbench.recordings.drives import AZIMUTH, KEPT, NONE, read_drive
from puckbench.results.row_files import write_rows
from puckbench.steps.measure_drive import TaskStep
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

    def run(self, drive: Path, rows: Path) -> dict[str, Any]:
        """Write a row of results for each kind of times to the file `rows` (Parquet)."""
        original = read_drive(drive)
        results = [
            {**row, "rate": _RATES[row["times"]]}
            for row in self.rows(
                original, original.turns, {"codec": UNDECODED, "rate": ""}, drive.stem
            )
        ]
        write_rows(rows, results)
        return {"rates": len(results)}
