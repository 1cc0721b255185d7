"""Plane residuals in closed form, with hidden biases, for the tests of the calibration.

A sensor stands `distance` before a wall; its lasers meet the wall at rings. The range error of a
return is the bias of its laser, that of its laser in this scan, that of its laser in this frame,
and the ray's noise; the residual is minus the error times the cosine of the incidence.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

ELEVATIONS = np.radians(np.arange(-15.0, 16.0, 2.0))
DISTANCES = (1.0, 2.0, 4.0, 7.0)


def residuals(
    seed: int,
    *,
    laser: float = 0.0,
    scan: float = 0.0,
    frame: float = 0.0,
    ray: tuple[float, float, float] = (0.006, 0.0, 0.0),
    frames: int = 6,
    laplace: bool = False,
    planes: bool = True,
) -> pd.DataFrame:
    """A table of 4 walls x 16 lasers x `frames` x 12 returns; sigmas in m.

    planes: fit each wall's plane by least squares, as a measurement has to.
    """
    rng = np.random.default_rng(seed)
    biases = laser * rng.standard_normal(16)
    parts = [
        _wall(distance, biases, (scan, frame, ray), frames, laplace, rng) for distance in DISTANCES
    ]
    if planes:
        for part in parts:
            terms = np.column_stack([np.ones(len(part)), part["plane_u_m"], part["plane_v_m"]])
            fitted, *_ = np.linalg.lstsq(terms, part["residual_m"], rcond=None)
            part["residual_m"] -= terms @ fitted
    return pd.concat(parts, ignore_index=True)


def _wall(
    distance: float,
    biases: np.ndarray,
    sigmas: tuple[float, float, tuple[float, float, float]],
    frames: int,
    laplace: bool,
    rng: np.random.Generator,
) -> pd.DataFrame:
    scan, frame, ray = sigmas
    which, number = (part.ravel() for part in np.mgrid[0:16, 0:frames])
    drawn = biases + scan * rng.standard_normal(16)
    cells = drawn[which] + frame * rng.standard_normal(len(which))
    # Several pitches of the sensor, so that a laser meets the wall at many heights.
    pitch = np.radians(np.linspace(-40, 40, frames))[number] if frames > 1 else 0 * number
    laser, height = np.repeat(which, 12), np.repeat(ELEVATIONS[which] + pitch, 12)
    azimuth = np.tile(np.radians(np.linspace(-35, 35, 12)), len(which))
    cosine = np.cos(height) * np.cos(azimuth)
    far, angle = distance / cosine, np.arccos(cosine)
    scale = ray[0] + ray[1] * angle**2 + ray[2] * far
    noise = rng.laplace(scale=np.sqrt(0.5), size=len(far)) if laplace else rng.normal(size=len(far))
    error = np.repeat(cells, 12) + scale * noise
    measured = far + error
    return pd.DataFrame(
        {
            "model": "hidden",
            "surface": "wall",
            "distance_m": distance,
            "run": 1,
            "laser_id": laser,
            "elevation_deg": np.degrees(ELEVATIONS)[laser],
            "residual_m": -error * cosine,
            "incidence_rad": angle,
            "range_m": measured,
            "frame": np.repeat(number, 12),
            "plane_u_m": measured * np.cos(height) * np.sin(azimuth),
            "plane_v_m": measured * np.sin(height),
        }
    )
