"""`puckbench residuals`: plane residuals of virtual wall and floor scans (thesis Procedure 1)."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object, whole


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("out", type=Path, help="residual table to write (.parquet)")
    parser.add_argument("--model", default="vlp16", help="error model (default: vlp16)")
    parser.add_argument("--model-options", type=json_object, default={}, help="JSON")
    parser.add_argument(
        "--distances",
        nargs="+",
        type=float,
        default=[1.0, 2.0, 3.0, 4.0, 5.0],
        metavar="M",
        help="from the wall, metres: 1 to 5, or 30 (default: 1 2 3 4 5)",
    )
    parser.add_argument("--runs", type=whole(1), default=3, help="per distance (default: 3)")
    parser.add_argument("--seed", type=whole(0), default=0)
    parser.add_argument("--keep", type=whole(1), help="rows of each scan, chosen at random")
    parser.add_argument(
        "--refit", action="store_true", help="least-squares planes instead of RANSAC's own"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Scan, fit and write the table."""
    from puckbench.analysis.residuals import Procedure, residual_table, write_residuals

    procedure = Procedure(
        options.model, options.model_options, refit=options.refit, keep=options.keep
    )
    table = residual_table(procedure, options.distances, options.runs, options.seed)
    write_residuals(options.out, table)
    residuals = table["residual_m"].astype("float64")
    return {
        "model": options.model,
        "rows": len(table),
        "mean_m": float(residuals.mean()),
        "std_m": float(residuals.std()),
    }
