from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from puckbench.jobs.registry import JOBS, Job
from puckbench.jobs.tables.results import CLOUD_KEYS, PLAN_TABLES, ROWS, cloud_row, table_of

if TYPE_CHECKING:
    import pandas as pd


class OfNames(Job):
    """Base class of jobs that read files by names relative to the results folder."""

    names: tuple[str, ...] = ()

    def files(self, results: Path) -> list[Path]:
        return [results / name for name in self.names]


@JOBS.register("rows_table")
class RowsTable(OfNames):
    """Gather the result rows of one kind from the files of all jobs."""

    kind: Literal["metrics", "scan_errors", "recovery", "drives"]

    def run(
        self, results: Path, csv: Path, parquet: Path, columns: Path | None = None
    ) -> dict[str, Any]:
        make, keys = ROWS[self.kind]
        return _write(table_of(make(self.files(results)), keys), columns, csv, parquet)


@JOBS.register("clouds_table")
class CloudsTable(OfNames):
    """Gather the descriptions of the prepared clouds."""

    def run(
        self, results: Path, csv: Path, parquet: Path, columns: Path | None = None
    ) -> dict[str, Any]:
        rows = [cloud_row(file.parent.name, file) for file in self.files(results)]
        return _write(table_of(rows, CLOUD_KEYS), columns, csv, parquet)


@JOBS.register("plan_table")
class PlanTable(Job):
    """Write a table of rows that the plan contains: ``left_out`` or ``codecs``."""

    table: str
    rows: tuple[dict[str, str], ...]

    def run(
        self, csv: Path, parquet: Path, results: Path | None = None, columns: Path | None = None
    ) -> dict[str, Any]:
        return _write(PLAN_TABLES[self.table](self.rows), columns, csv, parquet)


def _write(table: pd.DataFrame, columns: Path | None, *files: Path) -> dict[str, int]:
    from puckbench.jobs.table_files import write_result

    write_result(table, columns, *files)
    return {"rows": len(table)}
