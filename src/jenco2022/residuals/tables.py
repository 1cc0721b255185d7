"""Tables of residuals of several error models and captures, joined or compared on the same rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from pointkit.seeding import generator
from virtual_lidar.errors import Draws, ErrorModel, Hits
from virtual_lidar.errors.calibrated import Calibrated
from virtual_lidar.residual_table import REAL

WALL_KEYS = ["capture", "distance_m", "run"]
REPLICATES = 20
_FRAME_RAD = np.radians(15.0)
"""Azimuth range of a frame of the thesis's sweep, in rad. Error models draw a new bias for each
frame.
"""


def real_walls(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Join residual tables of captures, and keep the rows of walls, for `compared_residuals`.

    Parameters
    ----------
    tables
        A table for each capture.

    Returns
    -------
    DataFrame
        Rows of walls. ``capture`` is the number of the row's table, from 1, and ``replicate`` is 0.

    Raises
    ------
    InputError
        A table has no wall, or lacks columns that a calibration needs.
    """
    from virtual_lidar.calibration.observations import PLACE

    parts = []
    for number, table in enumerate(tables, 1):
        if missing := [name for name in PLACE if name not in table]:
            raise InputError(f"the residual table has no {', '.join(missing)}: measure it again")
        walls = table[(table["model"] == REAL) & (table["surface"] == "wall")]
        if walls.empty:
            raise InputError(f"residual table {number} has no wall of a capture")
        parts.append(walls.assign(model=REAL, surface="wall", capture=number, replicate=0))
    return pd.concat(parts, ignore_index=True)


def compared_residuals(
    walls: pd.DataFrame,
    models: Mapping[str, ErrorModel],
    *,
    replicates: int = REPLICATES,
    seed: int = 0,
) -> pd.DataFrame:
    """Simulate error models on the rays of real walls, and return all residuals.

    Parameters
    ----------
    walls
        Table of `real_walls`.
    models
        Error models by name. A `Calibrated` model draws a new device for each capture and
        simulation.
    replicates
        Number of simulations of each model.
    seed
        Seed of the simulations.

    Returns
    -------
    DataFrame
        The rows of `walls`, then those of the simulations, with the model's name in ``model``, the
        number of the simulation in ``replicate``, and in ``residual_m`` the distances (m) from
        planes that are fitted to each wall by least squares.
    """
    replicas = [
        _replica(walls, name, model, replicate, seed)
        for name, model in models.items()
        for replicate in range(replicates)
    ]
    real = walls.assign(residual_m=_from_planes(walls, walls["residual_m"].to_numpy(float)))
    return pd.concat([real, *replicas], ignore_index=True)


def _replica(
    walls: pd.DataFrame, name: str, model: ErrorModel, replicate: int, seed: int
) -> pd.DataFrame:
    errors = np.empty(len(walls))
    for number, rows in enumerate(_rows_of_walls(walls)):
        wall = walls.iloc[rows]
        rng = generator(seed, "compared", name, f"wall {number}", f"replicate {replicate}")
        device = _device(model, replicate, int(wall["capture"].iloc[0]))
        errors[rows] = _range_errors(wall, device, rng)
    residuals = -errors * np.cos(walls["incidence_rad"].to_numpy(dtype=np.float64))
    return walls.assign(model=name, replicate=replicate, residual_m=_from_planes(walls, residuals))


def _device(model: ErrorModel, replicate: int, capture: int) -> ErrorModel:
    if not isinstance(model, Calibrated):
        return model
    return model.replaced(file=None, device=1 + 1000 * replicate + capture)


def _range_errors(rows: pd.DataFrame, model: ErrorModel, rng: np.random.Generator) -> Floats:
    sensor = load_sensor("vlp16")
    azimuth = np.arctan2(rows["plane_u_m"], rows["distance_m"])
    frames = rows["frame"] * 24 + np.floor(azimuth / _FRAME_RAD)
    frame = np.unique(frames, return_inverse=True)[1]
    laser = rows["laser_id"].to_numpy(dtype=np.int64)
    group = pd.Series(frame * sensor.lasers + laser)
    place = (frame, np.asarray(group.groupby(group).cumcount()), laser)
    shape = (int(frame.max()) + 1, int(place[1].max()) + 1, sensor.lasers)
    distance, angle = np.full(shape, np.inf), np.full(shape, np.nan)
    distance[place] = rows["range_m"]
    angle[place] = rows["incidence_rad"]
    hits = Hits(distance, np.zeros(shape, dtype=np.uint32), angle)
    noisy = model.perturb_ranges(hits, sensor, Draws(rng))
    return np.asarray(noisy[place] - distance[place])


def _rows_of_walls(rows: pd.DataFrame) -> list[NDArray[np.intp]]:
    wall = np.asarray(rows.groupby(WALL_KEYS).ngroup())
    return [np.flatnonzero(wall == number) for number in range(int(wall.max()) + 1)]


def _from_planes(walls: pd.DataFrame, residuals: Floats) -> Floats:
    refitted = residuals.copy()
    places = walls[["plane_u_m", "plane_v_m"]].to_numpy(dtype=np.float64)
    for rows in _rows_of_walls(walls):
        terms = np.column_stack([np.ones(len(rows)), places[rows]])
        coefficients, *_ = np.linalg.lstsq(terms, residuals[rows], rcond=None)
        refitted[rows] -= terms @ coefficients
    return refitted


JOINED = {
    "residuals": (
        *("model", "surface", "distance_m", "run", "laser_id", "elevation_deg"),
        *("residual_m", "incidence_rad"),
    ),
    "scans": (
        *("model", "surface", "distance_m", "laser_id", "elevation_deg", "x_m", "y_m", "z_m"),
        *("range_error_m", "incidence_rad"),
    ),
}
"""Columns of joined tables that figures and statistics use, by kind of the table."""

MAX_ROWS = 500_000
"""Largest number of rows that are kept of each table, chosen at random; captures have any length.
"""


def joined_files(files: Sequence[tuple[str, Path]], kind: str) -> pd.DataFrame:
    """Join Parquet tables of several error models into one table.

    Parameters
    ----------
    files
        For each table: the name that the column ``model`` gets, and the path. Of tables that are
        longer than `MAX_ROWS`, only so many random rows are kept.
    kind
        "residuals" or "scans", which determines the columns (`JOINED`).

    Returns
    -------
    DataFrame
        The rows of all tables, in the columns ``JOINED[kind]``.

    Raises
    ------
    InputError
        A file lacks a column.
    """
    table = pd.concat([_part(*file, JOINED[kind]) for file in files], ignore_index=True)
    return table.astype({"model": "category", "surface": "category"})


def _part(name: str, path: Path, columns: Sequence[str]) -> pd.DataFrame:
    table = pd.read_parquet(path)
    if missing := [column for column in columns if column not in table]:
        raise InputError(f"{path}: no column {missing[0]!r}")
    rows = subsampled(table, MAX_ROWS, name)
    return rows.assign(model=name)[list(columns)].astype({"surface": str})


def subsampled(table: pd.DataFrame, max_rows: int, name: str) -> pd.DataFrame:
    """Return at most `max_rows` random rows in their original order.

    The choice is reproducible, because `name` determines the seed.
    """
    if len(table) <= max_rows:
        return table
    return table.sample(max_rows, random_state=generator(0, "joined", name)).sort_index()
