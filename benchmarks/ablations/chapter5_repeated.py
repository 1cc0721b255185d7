"""Scatter of the thesis's chapter 5: its residual study, repeated with other seeds.

    python -m benchmarks.ablations.chapter5_repeated [REPETITIONS]

Each repetition is config/chapter5.yaml with another seed, all points kept: per error model the
standard deviation of the plane residuals from 1 to 5 m and from 30 m, and the earth mover's
distance from 1 to 5 m to a normal distribution with the moments of the real residuals.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import yaml

from puckbench.thesis import published
from puckbench.thesis.residuals.virtual import Procedure, residual_table
from puckbench.thesis.tables.numbers import distance_to_normal

CONFIG = Path(__file__).parents[2] / "config" / "chapter5.yaml"


def main() -> None:
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    study = yaml.safe_load(CONFIG.read_text())["sensor_study"]
    print(f"{'model':24} {'std 1-5 m':>22} {'std 30 m':>22} {'distance to real':>22}")
    for name, entry in study["models"].items():
        procedure = Procedure(entry.get("errors", name), entry.get("error_options", {}))
        runs = np.array([numbers(procedure, study, seed) for seed in range(1, repetitions + 1)])
        print(f"{name:24}", *(text(values) for values in runs.T))


def numbers(procedure: Procedure, study: dict, seed: int) -> tuple[float, float, float]:
    """Spread near, spread far and distance of one repetition, m."""
    distances = [*study["distances_m"], study["far_m"]]
    table = residual_table(procedure, distances, study["runs"], seed)
    residuals = table["residual_m"].to_numpy(dtype=float)
    near = (table["distance_m"] < published.FAR_M).to_numpy()
    moved = distance_to_normal(residuals[near], published.REAL_MEAN_M, published.REAL_STD_M)
    return residuals[near].std(), residuals[~near].std(), moved


def text(values: np.ndarray) -> str:
    return f"{values.mean():8.4f} ({values.min():.4f}-{values.max():.4f})"


if __name__ == "__main__":
    main()
