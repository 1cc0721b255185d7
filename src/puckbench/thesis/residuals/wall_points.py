"""The points of wall and floor scans, in the wall's own frame (thesis Figures 5.2-5.9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from puckbench.core.seeding import generator
from puckbench.lidar import ScanTable, Sensor, load_sensor, open_error_model, scan
from puckbench.scenes.calibration import calibration_scene
from puckbench.thesis.residuals import joining
from puckbench.thesis.residuals.virtual import Procedure

SURFACES = ("wall", "floor", "surroundings")
COLUMNS = joining.COLUMNS["scans"]
"""Columns of a table of points: the wall is at y = 0, the floor at z = 0, the sensor at
y = `distance_m`, z = 1; `range_error_m` is the measured distance less the true one. Wall and floor
are parts of a room; what else the sensor sees of it is the surface "surroundings"."""


def wall_points(
    procedure: Procedure, distances: Sequence[float], seed: int, run: int = 1
) -> pd.DataFrame:
    """Points of the scan that Procedure 1 makes in one run at each distance, m, before it crops.

    They are the very ones that its residuals are taken from, but for rays that divergence turns
    over an edge of wall or floor: here they hit the room around them. `procedure.keep` bounds the
    points of a surface at a distance. Columns as in `COLUMNS`. Raises InputError for a distance
    that no calibration scene has, or an unknown model.
    """
    parts = [_scan_points(procedure, distance, run, seed) for distance in distances]
    return pd.concat(parts, ignore_index=True)


def _scan_points(procedure: Procedure, distance: float, run: int, seed: int) -> pd.DataFrame:
    mesh, origin = calibration_scene(distance, room=True)
    sensor = load_sensor(procedure.sensor)
    names = ("residuals", procedure.model, f"{distance:g} m", f"run {run}")
    model = open_error_model(procedure.model, procedure.options)
    returns = scan(mesh, sensor, procedure.sweep, model, origin, generator(seed, *names, "scan"))
    objects = mesh.labels.objects if mesh.labels else ()
    surfaces = np.array([one.semantic for one in objects])[returns.object_id]
    rng, parts = generator(seed, *names, "points"), []
    for surface in SURFACES:
        rows = returns.select(_some(np.flatnonzero(surfaces == surface), procedure.keep, rng))
        parts.append(_points(rows, sensor, procedure.model, surface, distance))
    return pd.concat(parts, ignore_index=True)


def _some(rows: NDArray[Any], most: int | None, rng: np.random.Generator) -> NDArray[Any]:
    if most is None or len(rows) <= most:
        return rows
    return np.sort(rng.choice(rows, most, replace=False))


def _points(
    rows: ScanTable, sensor: Sensor, model: str, surface: str, distance: float
) -> pd.DataFrame:
    elevations = np.array(sensor.laser_elevation_deg)
    x, y, z = rows.xyz_noisy.T
    numbers = {
        "elevation_deg": elevations[rows["laser_id"]],
        # A sweep looks towards +y, so the scene was turned by half a turn.
        "x_m": -x,
        "y_m": -y,
        "z_m": z,
        "range_error_m": rows["distance_noisy"] - rows["distance"],
        "incidence_rad": rows["incidence"],
    }
    table = pd.DataFrame({name: column.astype(np.float32) for name, column in numbers.items()})
    table["laser_id"] = rows["laser_id"]
    table = table.assign(model=model, surface=surface, distance_m=np.float32(distance))
    return table[list(COLUMNS)]
