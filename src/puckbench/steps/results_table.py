from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.core.code import TABLES
from puckbench.steps.step import STEPS, PlannedStep, Step, planned
from puckbench.tables.files import write_result
from puckbench.tables.registry import table_entry

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*TABLES, "puckbench.tables.gathered")


class JoiningStep(Step):
    """Base class of steps that read many files of results.

    `names` are the paths of the files, relative to the results folder.
    """

    names: tuple[str, ...] = ()

    def files(self, results: Path) -> list[Path]:
        """Return the paths of the files in a results folder."""
        return [results / name for name in self.names]


@STEPS.register("results_table")
class ResultsTable(JoiningStep):
    """Join the rows of results that many steps wrote, or rows that are known before the run.

    Parameters
    ----------
    table
        Name of the table.
    rows
        Rows of a table that is known before the run: values by name of the column.
    """

    table: str
    rows: tuple[dict[str, str], ...] = ()

    @classmethod
    def of_plan(cls, flow: Workflow, /, table: str) -> PlannedStep:
        names, rows = flow.outputs.gathered[table]
        inputs = {"rows": [f"{flow.plan.results}/{name}" for name in names]}
        return planned(cls(table=table, names=names, rows=rows), inputs, memory_mb=1000)

    def run(self, results: Path, csv: Path, parquet: Path, columns: Path) -> dict[str, Any]:
        """Write the table and the meanings of its columns, and return the number of rows.

        `results` is the results folder, in which the files `names` are.
        """
        source = self.files(results) if self.names else self.rows
        return write_result(table_entry(self.table).make(source), columns, csv, parquet)
