from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from puckbench.core.code import TABLES
from puckbench.jobs.registry import JOBS, Job
from puckbench.tables.files import write_result
from puckbench.tables.registry import table_entry

CODE = (*TABLES, "puckbench.tables.gathered")


class OfNames(Job):
    """Base class of jobs that read many files of results.

    `names` are the paths of the files, relative to the results folder.
    """

    names: tuple[str, ...] = ()

    def files(self, results: Path) -> list[Path]:
        """Return the paths of the files in a results folder."""
        return [results / name for name in self.names]


@JOBS.register("rows_table")
class RowsTable(OfNames):
    """Join the rows of results that many jobs wrote to a table.

    `kind` is the name of the table.
    """

    kind: Literal["metrics", "clouds", "scan_errors", "recovery", "drives"]

    def run(
        self, results: Path, csv: Path, parquet: Path, columns: Path | None = None
    ) -> dict[str, Any]:
        """Write the table to `csv` and `parquet`, and return the number of rows.

        If `columns` is set, the meanings of the columns are written to it.
        """
        table = table_entry(self.kind).make(self.files(results))
        return write_result(table, columns, csv, parquet)


@JOBS.register("plan_table")
class PlanTable(Job):
    """Write a table whose rows are known before the run.

    Parameters
    ----------
    table
        Name of the table, ``left_out`` or ``codecs``.
    rows
        Rows of the table: values by name of the column.
    """

    table: str
    rows: tuple[dict[str, str], ...]

    def run(
        self, csv: Path, parquet: Path, results: Path | None = None, columns: Path | None = None
    ) -> dict[str, Any]:
        """Write the table to `csv` and `parquet`, and return the number of rows.

        If `columns` is set, the meanings of the columns are written to it. `results` is not used.
        """
        return write_result(table_entry(self.table).make(self.rows), columns, csv, parquet)
