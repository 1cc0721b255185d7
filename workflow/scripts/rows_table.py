"""Scans' own errors, or recovered primitives: all result rows as one table (CSV and Parquet)."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench import tables
from puckbench.tablefiles import write_table

if TYPE_CHECKING:
    snakemake: Any = None

rows, keys = tables.ROWS[snakemake.params.kind]
table = tables.table_of(rows(list(map(Path, snakemake.input))), keys)
write_table(table, Path(snakemake.output.csv), Path(snakemake.output.parquet))
