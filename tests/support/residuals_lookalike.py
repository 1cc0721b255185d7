"""A table of plane residuals in closed form, for the tests of chapter 5's figures.

The sensor stands 1 m above the floor and d metres before the wall; a ray of pitch p meets the wall
at incidence |p| or the floor at 90 degrees - |p|. Its residual is (bias + noise) cos(incidence);
real ones are Gaussian along the normal, as the thesis found.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pointkit.seeding import generator

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


def scan_table(per_part: int = 300) -> pd.DataFrame:
    """Points of a wall (y = 0) and a floor (z = 0) seen from 1 and 5 m, by laser and model.

    Noise moves a point along its ray from the sensor at (0, distance, 1), by a bias per laser.
    """
    return pd.concat(
        [
            _points(model, surface, distance, per_part)
            for model in (*SIGMAS, "vlp16_incidence")
            for distance in (1.0, 5.0)
            for surface in ("wall", "floor")
        ],
        ignore_index=True,
    )


def _points(model: str, surface: str, distance: float, rows: int) -> pd.DataFrame:
    rng = generator(5, "points", model, surface, str(distance))
    true = rng.uniform([-0.8, 0, 0], [0.8, distance, 2.2], (rows, 3))
    true[:, 1 if surface == "wall" else 2] = 0
    laser = rng.integers(0, 16, rows)
    bias, noise = SIGMAS.get(model, (0.014, 0.02))
    error = bias * rng.normal(size=16)[laser] + noise * rng.normal(size=rows)
    rays = true - [0, distance, 1]
    points = true + error[:, None] * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    keys = {"model": model, "surface": surface, "distance_m": distance, "laser_id": laser}
    elevations = np.array(ELEVATIONS, dtype=float)[laser]
    xyz = dict(zip(("x_m", "y_m", "z_m"), points.T, strict=True))
    return pd.DataFrame({**keys, "elevation_deg": elevations, **xyz})
