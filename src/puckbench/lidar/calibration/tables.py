"""Residual tables as a calibration takes them: rows of one model, and settings that suit them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from puckbench.core.errors import InputError
from puckbench.lidar.calibration.calibrating import FRAME, SPOT, Settings
from puckbench.lidar.calibration.likelihood import NAMES
from puckbench.lidar.residual_table import REAL, read_residuals

# The VLP-16 tells ranges in steps of 2 mm (User Manual 63-9243 Rev. E, section 9.3).
_CAPTURE_QUANTUM_M = 0.002


def read_tables(paths: Sequence[Path], model: str | None) -> tuple[list[pd.DataFrame], str]:
    """The rows of one model in each table, and which one: `model`, or the only one that there is.

    Raises InputError, with the file's name, for a table without such rows or with several models.
    """
    tables = [read_residuals(path) for path in paths]
    models = sorted({str(name) for table in tables for name in table["model"].unique()})
    if model is None and len(models) > 1:
        raise InputError(f"the tables have the models {', '.join(models)}: choose one")
    chosen = model or (models[0] if models else "")
    kept = [table[table["model"] == chosen] for table in tables]
    for path, table in zip(paths, kept, strict=True):
        if table.empty:
            raise InputError(f"{path}: no row of the model {chosen!r}")
    return kept, chosen


def settings_for(
    model: str,
    cells: str | None = None,
    parameters: Sequence[str] | None = None,
    quantum_mm: float | None = None,
) -> Settings:
    """Settings for the residuals of a model: spots and steps of 2 mm for those of captures.

    What is not None is as given.
    """
    real = model == REAL
    quantum_m = (_CAPTURE_QUANTUM_M if real else 0.0) if quantum_mm is None else quantum_mm / 1000
    default = SPOT if real else FRAME
    return Settings(cells or default, tuple(parameters or NAMES), quantum_m)
