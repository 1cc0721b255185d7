"""Walls of captures, and what error models make of the same rays, for the verdict on the models."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.io.tables import write_table
from puckbench.lidar.residual_table import read_residuals
from puckbench.thesis.residuals.joining import thinned
from puckbench.thesis.residuals.model_comparison import (
    compared_residuals,
    default_models,
    real_walls,
)

if TYPE_CHECKING:
    snakemake: Any = None

# Each model is drawn twenty times on every row.
MOST_ROWS = 20_000
KEPT = ["model", "replicate", "capture", "distance_m", "run", "laser_id", "residual_m"]

tables = [thinned(read_residuals(Path(path)), MOST_ROWS, str(path)) for path in snakemake.input]
compared = compared_residuals(real_walls(tables), default_models())
write_table(compared[KEPT].astype({"residual_m": "float32"}), Path(str(snakemake.output)))
