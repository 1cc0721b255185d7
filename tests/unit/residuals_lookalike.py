"""A table of plane residuals in closed form, for the tests of chapter 5's figures.

The sensor stands 1 m above the floor and d metres before the wall; a ray of pitch p meets the wall
at incidence |p| or the floor at 90 degrees - |p|. Its residual is (bias + noise) cos(incidence);
real ones are Gaussian along the normal, as the thesis found.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from puckbench.seeding import generator

ELEVATIONS = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
SIGMAS = {  # bias of a laser, noise of a ray, metres
    "none": (0.0, 1e-7),
    "hdl64e": (0.078, 0.010),
    "vlp16": (0.014, 0.010),
    "vlp16_divergence": (0.014, 0.010),
}
REAL_STD_M = 0.014


def residual_table(per_part: int = 400, real: bool = True) -> pd.DataFrame:
    """So many rows per model, surface, distance (1 to 5 m and 30 m, real ones to 5 m only)."""
    models = [*(["real"] if real else []), *SIGMAS]
    parts = [
        _part(model, surface, distance, per_part)
        for model in models
        for distance in (1.0, 2.0, 3.0, 4.0, 5.0, 30.0)
        for surface in ("wall", "floor")
        if distance < 30 or (model != "real" and surface == "wall")
    ]
    return pd.concat(parts, ignore_index=True)


def _part(model: str, surface: str, distance: float, rows: int) -> pd.DataFrame:
    rng = generator(5, "residuals", model, surface, str(distance))
    incidence = _incidence(surface, distance, rows, rng)
    laser = rng.integers(0, 16, rows)
    if model == "real":
        residual = REAL_STD_M * rng.normal(size=rows)
    else:
        bias, noise = SIGMAS[model]
        frame = rng.integers(0, 40, rows)
        biases = bias * rng.normal(size=(40, 16))
        residual = (biases[frame, laser] + noise * rng.normal(size=rows)) * np.cos(incidence)
    return pd.DataFrame(
        {
            "model": model,
            "surface": surface,
            "distance_m": distance,
            "run": 0,
            "laser_id": laser,
            "elevation_deg": np.array(ELEVATIONS, dtype=float)[laser],
            "residual_m": residual,
            "incidence_rad": incidence,
        }
    )


def _incidence(surface: str, distance: float, rows: int, rng: np.random.Generator) -> np.ndarray:
    if surface == "wall":
        return np.abs(np.arctan(rng.uniform(-1.0, 1.2, rows) / distance))
    return np.arctan(rng.uniform(0.15, distance, rows))
