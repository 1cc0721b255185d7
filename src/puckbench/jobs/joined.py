"""Rows and tables of many jobs as one table (CSV and Parquet)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from puckbench.jobs.registry import JOBS, Job


class OfNames(Job):
    """A job on files of many others; names: of these files, below the results folder."""

    names: tuple[str, ...] = ()

    def files(self, results: Path) -> list[Path]:
        """The files, in a results folder."""
        return [results / name for name in self.names]


@JOBS.register("rows_table")
class RowsTable(OfNames):
    """All result rows of a kind."""

    kind: Literal["metrics", "scan_errors", "recovery"]

    def run(self, results: Path, csv: Path, parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.jobs import result_tables

        make, keys = result_tables.ROWS[self.kind]
        table = result_tables.table_of(make(self.files(results)), keys)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("clouds_table")
class CloudsTable(OfNames):
    """What the prepared clouds are, one row each; names: of their descriptions."""

    def run(self, results: Path, csv: Path, parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.jobs import result_tables

        rows = [result_tables.cloud_row(file.parent.name, file) for file in self.files(results)]
        table = result_tables.table_of(rows, result_tables.CLOUD_KEYS)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("left_out")
class LeftOut(Job):
    """Files and scenes that could not be used, a row each, and why."""

    rows: tuple[dict[str, str], ...]

    def run(self, csv: Path, parquet: Path, results: Path | None = None) -> dict[str, Any]:
        """Write the table; results: not used."""
        from puckbench.io.tables import write_table
        from puckbench.jobs import result_tables

        table = result_tables.left_out(self.rows)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("joined_table")
class AllModels(OfNames):
    """Tables of several error models and recordings as one.

    models: what stands in the column ``model``, one for each table.
    """

    kind: Literal["residuals", "scans"]
    models: tuple[str, ...]

    def run(self, results: Path, parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.thesis.residuals.joining import joined_files

        table = joined_files(list(zip(self.models, self.files(results), strict=True)), self.kind)
        write_table(table, parquet)
        return {"rows": len(table)}


_MOST_ROWS = 20_000
"""Of a recording: each model is drawn twenty times on every row."""
_KEPT = ["model", "replicate", "capture", "distance_m", "run", "laser_id", "residual_m"]


@JOBS.register("compared_residuals")
class ComparedResiduals(OfNames):
    """Walls of recordings, and what error models make of the same rays."""

    def run(self, results: Path, parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.lidar.residual_table import read_residuals
        from puckbench.thesis.residuals.joining import subsampled
        from puckbench.thesis.residuals.model_comparison import (
            compared_residuals,
            default_models,
            real_walls,
        )

        files = self.files(results)
        tables = [subsampled(read_residuals(path), _MOST_ROWS, str(path)) for path in files]
        compared = compared_residuals(real_walls(tables), default_models())
        write_table(compared[_KEPT].astype({"residual_m": "float32"}), parquet)
        return {"rows": len(compared)}
