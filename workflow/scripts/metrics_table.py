"""All result rows as one table (CSV and Parquet), and the medians per data set, codec and rate."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench import tables
from puckbench.tablefiles import write_table

if TYPE_CHECKING:
    snakemake: Any = None

table = tables.table_of(tables.metric_rows(map(Path, snakemake.input)), tables.METRIC_KEYS)
write_table(table, Path(snakemake.output.csv), Path(snakemake.output.parquet))
write_table(tables.summary(table), Path(snakemake.output.summary))
