"""Rows and tables of many jobs as one table (CSV and Parquet)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from puckbench.jobs.registry import JOBS, Job


class OfRows(Job):
    """A job on result rows; rates: of a curve, by its codec and first rate ("draco/r1").

    Of each curve it is given the row of the first rate, and reads the others beside it.
    """

    rates: dict[str, tuple[str, ...]] = Field({})

    def every(self, rows: Iterable[Path]) -> list[Path]:
        """The rows of all rates."""
        return [path for row in rows for path in self._of_curve(row)]

    def _of_curve(self, row: Path) -> list[Path]:
        rates = self.rates.get(f"{row.parent.name}/{row.stem}")
        return [row] if rates is None else [row.with_name(f"{rate}.json") for rate in rates]


@JOBS.register("metrics_table")
class MetricsTable(OfRows):
    """All result rows, and the medians per data set, codec and rate."""

    def run(
        self, rows: tuple[Path, ...], csv: Path, parquet: Path, summary: Path
    ) -> dict[str, Any]:
        """Write the table and its summary."""
        from puckbench.io.tables import write_table
        from puckbench.jobs import result_tables

        found = result_tables.metric_rows(self.every(rows))
        table = result_tables.table_of(found, result_tables.METRIC_KEYS)
        write_table(table, csv, parquet)
        write_table(result_tables.summary(table), summary)
        return {"rows": len(table)}


@JOBS.register("clouds_table")
class CloudsTable(Job):
    """What the prepared clouds are, one row each; datasets: of each cloud."""

    datasets: tuple[str, ...]

    def run(self, rows: tuple[Path, ...], csv: Path, parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.jobs import result_tables

        pairs = zip(self.datasets, rows, strict=True)
        found = [result_tables.cloud_row(*pair) for pair in pairs]
        table = result_tables.table_of(found, result_tables.CLOUD_KEYS)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("left_out")
class LeftOut(Job):
    """Files and scenes that could not be used, a row each, and why."""

    rows: tuple[dict[str, str], ...]

    def run(self, csv: Path, parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.jobs import result_tables

        table = result_tables.left_out(self.rows)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("rows_table")
class RowsTable(OfRows):
    """Scans' own errors, or recovered primitives: all result rows of that kind."""

    kind: Literal["scan_errors", "recovery"]

    def run(self, rows: tuple[Path, ...], csv: Path, parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.jobs import result_tables

        make, keys = result_tables.ROWS[self.kind]
        table = result_tables.table_of(make(self.every(rows)), keys)
        write_table(table, csv, parquet)
        return {"rows": len(table)}


@JOBS.register("joined_table")
class AllModels(Job):
    """Tables of several error models and recordings as one.

    names: what stands in the column ``model``, one for each table.
    """

    kind: Literal["residuals", "scans"]
    names: tuple[str, ...]

    def run(self, rows: tuple[Path, ...], parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.thesis.residuals.joining import joined_files

        table = joined_files(list(zip(self.names, rows, strict=True)), self.kind)
        write_table(table, parquet)
        return {"rows": len(table)}


_MOST_ROWS = 20_000
"""Of a recording: each model is drawn twenty times on every row."""
_KEPT = ["model", "replicate", "capture", "distance_m", "run", "laser_id", "residual_m"]


@JOBS.register("compared_residuals")
class ComparedResiduals(Job):
    """Walls of recordings, and what error models make of the same rays."""

    def run(self, rows: tuple[Path, ...], parquet: Path) -> dict[str, Any]:
        """Write the table."""
        from puckbench.io.tables import write_table
        from puckbench.lidar.residual_table import read_residuals
        from puckbench.thesis.residuals.joining import subsampled
        from puckbench.thesis.residuals.model_comparison import (
            compared_residuals,
            default_models,
            real_walls,
        )

        tables = [subsampled(read_residuals(path), _MOST_ROWS, str(path)) for path in rows]
        compared = compared_residuals(real_walls(tables), default_models())
        write_table(compared[_KEPT].astype({"residual_m": "float32"}), parquet)
        return {"rows": len(compared)}
