"""Tables of several models and captures as one, for the figures and statistics of chapter 5."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.io.tables import write_table
from puckbench.thesis.residuals.joining import joined_files

if TYPE_CHECKING:
    snakemake: Any = None

files = list(zip(snakemake.params.names, map(Path, snakemake.input), strict=True))
table = joined_files(files, snakemake.params.kind)
write_table(table, Path(str(snakemake.output)))
