"""What the prepared clouds are: one row each (CSV and Parquet)."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.io.tables import write_table
from puckbench.jobs import result_tables as tables

if TYPE_CHECKING:
    snakemake: Any = None

pairs = zip(snakemake.params.datasets, map(Path, snakemake.input), strict=True)
table = tables.table_of([tables.cloud_row(*pair) for pair in pairs], tables.CLOUD_KEYS)
write_table(table, Path(snakemake.output.csv), Path(snakemake.output.parquet))
