"""Tables gathered from files of many jobs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from puckbench.jobs.registry import JOBS, Job


class OfNames(Job):
    """A job that reads files of many others.

    Parameters
    ----------
    names
        Paths below the results folder.
    """

    names: tuple[str, ...] = ()

    def files(self, results: Path) -> list[Path]:
        return [results / name for name in self.names]


@JOBS.register("rows_table")
class RowsTable(OfNames):
    """Gather all result rows of a kind."""

    kind: Literal["metrics", "scan_errors", "recovery"]

    def run(self, results: Path, csv: Path, parquet: Path) -> dict[str, Any]:
        from puckbench.io.tables import write_table
        from puckbench.jobs.tables import results as result_tables

        make, keys = result_tables.ROWS[self.kind]
        table = result_tables.table_of(make(self.files(results)), keys)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("clouds_table")
class CloudsTable(OfNames):
    """Gather the descriptions of the prepared clouds."""

    def run(self, results: Path, csv: Path, parquet: Path) -> dict[str, Any]:
        from puckbench.io.tables import write_table
        from puckbench.jobs.tables import results as result_tables

        rows = [result_tables.cloud_row(file.parent.name, file) for file in self.files(results)]
        table = result_tables.table_of(rows, result_tables.CLOUD_KEYS)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("plan_table")
class PlanTable(Job):
    """Write a table whose rows a plan has: ``left_out`` or ``codecs``."""

    table: str
    rows: tuple[dict[str, str], ...]

    def run(self, csv: Path, parquet: Path, results: Path | None = None) -> dict[str, Any]:
        from puckbench.io.tables import write_table
        from puckbench.jobs.tables import results as result_tables

        table = result_tables.PLAN_TABLES[self.table](self.rows)
        write_table(table, csv, parquet)
        return {"rows": len(table)}
