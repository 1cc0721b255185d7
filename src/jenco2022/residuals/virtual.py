from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from jenco2022.residuals.tables import JOINED
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.geometry.ransac import THRESHOLD_M, Plane, ransac_plane
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.seeding import generator, random_rows
from virtual_lidar import ScanTable, Sweep, open_error_model, scan
from virtual_lidar.residual_table import COLUMNS, SURFACES, about_plane, joined
from virtual_lidar.scenes.calibration import calibration_scene

SWEEP = Sweep(frames_skipped=1)
"""The sweep of 4 s that the thesis used for scans of errors, without its last frame."""


@dataclass(frozen=True)
class Procedure:
    """Settings of Procedure 1 of the thesis: scan a wall and a floor, and fit a plane to each.

    Parameters
    ----------
    model
        Name of the error model.
    options
        Changes to the parameters of the error model.
    sensor
        Name of the sensor.
    sweep
        Rotation and motion of the sensor.
    threshold_m
        Largest distance of RANSAC's inliers from the plane, m.
    refit
        Whether planes are fitted to RANSAC's inliers by least squares. The thesis did not.
    keep
        Maximum number of rows of a scan, chosen at random; None keeps all.
    """

    model: str
    options: Mapping[str, Any] = field(default_factory=dict)
    sensor: str = "vlp16"
    sweep: Sweep = SWEEP
    threshold_m: float = THRESHOLD_M
    refit: bool = False
    keep: int | None = None


def residual_table(
    procedure: Procedure, distances: Sequence[float], runs: int, seed: int
) -> pd.DataFrame:
    """Return the plane residuals of `runs` scans from each distance.

    A plane residual is the signed distance of a point from the plane fitted to its surface.

    Parameters
    ----------
    procedure
        Settings of the scans and fits.
    distances
        Distances of the sensor from the wall, m; there are scenes for 1, 2, 3, 4, 5 and 30 m.
    runs
        Number of scans from each distance, which differ in the sensor's errors.
    seed
        Seed of all random numbers.

    Returns
    -------
    DataFrame
        A row for each return, in the columns `virtual_lidar.residual_table.COLUMNS`.

    Raises
    ------
    InputError
        A distance or the error model is unknown, or there is no distance or run.
    """
    if not distances or runs < 1:
        raise InputError("residuals need at least one distance and one run")
    return joined(
        [
            scan_residuals(procedure, distance, run, seed)
            for distance in distances
            for run in range(1, runs + 1)
        ]
    )


def scan_residuals(procedure: Procedure, distance: float, run: int, seed: int) -> pd.DataFrame:
    """Return the plane residuals of a single scan.

    A point belongs to the surface that its nominal ray hits. Surfaces are not cropped from the
    cloud, because cropping would remove noisy points.

    Parameters
    ----------
    procedure
        Settings of the scan and the fits.
    distance
        Distance of the sensor from the wall, in m.
    run
        Number of the scan, which changes the random errors.
    seed
        Seed of all random numbers.

    Returns
    -------
    DataFrame
        A row for each return, first those of the wall, then those of the floor, in firing order.
    """
    mesh, origin = calibration_scene(distance)
    sensor = load_sensor(procedure.sensor)
    names = ("residuals", procedure.model, f"{distance:g} m", f"run {run}")
    model = open_error_model(procedure.model, procedure.options)
    returns = scan(mesh, sensor, procedure.sweep, model, origin, generator(seed, *names, "scan"))
    parts = []
    for surface in SURFACES:
        rng = generator(seed, *names, "plane", surface)
        rows = _on_surface(returns, mesh, surface, distance)
        about = about_plane(rows.xyz_noisy, _plane(rows, origin, procedure, rng), origin)
        parts.append(_frame(rows, about, sensor, (procedure.model, surface, distance, run)))
    table = joined(parts)
    kept = random_rows(len(table), procedure.keep, generator(seed, *names, "keep"))
    return table.iloc[kept].reset_index(drop=True)


def _on_surface(returns: ScanTable, mesh: Mesh, surface: str, distance: float) -> ScanTable:
    objects = mesh.labels.objects if mesh.labels else ()
    ids = [number for number, each in enumerate(objects) if each.semantic == surface]
    rows = returns.select(np.isin(returns.object_id, ids))
    if len(rows) < 3:
        raise InputError(f"at {distance:g} m only {len(rows)} rays hit the {surface}")
    return rows


def _plane(
    rows: ScanTable, origin: Floats, procedure: Procedure, rng: np.random.Generator
) -> Plane:
    points = rows.xyz_noisy
    plane = ransac_plane(points, rng, threshold_m=procedure.threshold_m, refit=procedure.refit)
    return plane.facing(origin)


def _frame(
    rows: ScanTable, about: dict[str, Floats], sensor: Sensor, source: tuple[str, str, float, int]
) -> pd.DataFrame:
    model, surface, distance, run = source
    codes = np.zeros(len(rows), dtype=np.int8)
    elevations = np.array(sensor.laser_elevation_deg, dtype=np.float32)
    columns: dict[str, Any] = {
        "model": pd.Categorical.from_codes(codes, categories=pd.Index([model])),
        "surface": pd.Categorical.from_codes(
            codes + SURFACES.index(surface), categories=pd.Index(SURFACES)
        ),
        "distance_m": np.full(len(rows), distance, dtype=np.float32),
        "run": np.full(len(rows), run, dtype=np.int16),
        "laser_id": rows["laser_id"],
        "elevation_deg": elevations[rows["laser_id"]],
        "incidence_rad": rows["incidence"].astype(np.float32),
        "frame": rows["frame"],
        **about,
    }
    return pd.DataFrame({name: columns[name] for name in COLUMNS})


POINT_SURFACES = ("wall", "floor", "surroundings")
POINT_COLUMNS = JOINED["scans"]
"""Columns of a table of points.

The wall is at y = 0, the floor at z = 0, and the sensor at y = `distance_m`, z = 1 m.
`range_error_m` is the measured minus the true range. The surface "surroundings" is the rest of the
room.
"""


def wall_points(
    procedure: Procedure, distances: Sequence[float], seed: int, run: int = 1
) -> pd.DataFrame:
    """Return the points of scans of a wall, a floor and the rest of the room.

    Parameters
    ----------
    procedure
        Settings of the scans.
    distances
        Distances of the sensor from the wall, in m; one scan is made from each.
    seed
        Seed of all random numbers.
    run
        Number of the scan, which changes the random errors.

    Returns
    -------
    DataFrame
        A row for each point, in the columns `POINT_COLUMNS`.

    Raises
    ------
    InputError
        A distance or the error model is unknown.
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
    for surface in POINT_SURFACES:
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
    return table[list(POINT_COLUMNS)]
