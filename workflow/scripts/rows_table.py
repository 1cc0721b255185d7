"""Scans' own errors, or recovered primitives: all result rows as one table (CSV and Parquet)."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.io.tables import write_table
from puckbench.jobs import result_tables as tables

if TYPE_CHECKING:
    snakemake: Any = None

rows, keys = tables.ROWS[snakemake.params.kind]
table = tables.table_of(rows(list(map(Path, snakemake.input))), keys)
write_table(table, Path(snakemake.output.csv), Path(snakemake.output.parquet))
