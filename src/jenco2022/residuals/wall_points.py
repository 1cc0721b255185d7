from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jenco2022.residuals import joining
from jenco2022.residuals.virtual import Procedure
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.seeding import generator, random_rows
from virtual_lidar import ScanTable, open_error_model, scan
from virtual_lidar.scenes.calibration import calibration_scene

SURFACES = ("wall", "floor", "surroundings")
COLUMNS = joining.COLUMNS["scans"]
"""Columns of a table of points. The wall is at y = 0, the floor at z = 0, the sensor at y =
`distance_m`, z = 1 m; `range_error_m` is measured minus true range. "surroundings" is the rest of
the room."""


def wall_points(
    procedure: Procedure, distances: Sequence[float], seed: int, run: int = 1
) -> pd.DataFrame:
    """Return the points (`COLUMNS`) of one run of Procedure 1 at each distance, before cropping.

    Raises InputError for an unknown distance or model.
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
    surfaces = np.array([each.semantic for each in objects])[returns.object_id]
    rng, parts = generator(seed, *names, "points"), []
    for surface in SURFACES:
        of_surface = np.flatnonzero(surfaces == surface)
        rows = returns.select(of_surface[random_rows(len(of_surface), procedure.keep, rng)])
        parts.append(_points(rows, sensor, procedure.model, surface, distance))
    return pd.concat(parts, ignore_index=True)


def _points(
    rows: ScanTable, sensor: Sensor, model: str, surface: str, distance: float
) -> pd.DataFrame:
    elevations = np.array(sensor.laser_elevation_deg)
    x, y, z = rows.xyz_noisy.T
    numbers = {
        "elevation_deg": elevations[rows["laser_id"]],
        # Undo the half turn of the scene, by which the sweep (+y) faces the wall.
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
