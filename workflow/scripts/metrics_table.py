"""All result rows as one table (CSV and Parquet), and the medians per data set, codec and rate."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.io.tables import write_table
from puckbench.jobs import result_tables as tables

if TYPE_CHECKING:
    snakemake: Any = None

table = tables.table_of(tables.metric_rows(map(Path, snakemake.input)), tables.METRIC_KEYS)
write_table(table, Path(snakemake.output.csv), Path(snakemake.output.parquet))
write_table(tables.summary(table), Path(snakemake.output.summary))
