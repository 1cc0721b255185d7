"""Tables of plane residuals, with one row for each return of a virtual scan or a recording.

A plane residual is the signed distance of a measured point from the plane that was fitted to all
points of its surface (thesis, section 5.1.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.ransac import Plane

if TYPE_CHECKING:
    import pandas as pd

REAL = "real"
"""Value of the column `model` for recordings."""

SURFACES = ("wall", "floor")
"""Surfaces of a virtual scan; a recording may have others."""

COLUMNS = (
    "model",
    "surface",
    "distance_m",
    "run",
    "laser_id",
    "elevation_deg",
    "residual_m",
    "incidence_rad",
    "range_m",
    "frame",
    "plane_u_m",
    "plane_v_m",
)
"""Columns of a residual table; `residual_m` is positive on the sensor's side of the plane.

`range_m` is the distance from the sensor to the measured point, `frame` the frame of a scan or the
turn of a recording; `plane_u_m` and `plane_v_m` come from `plane_coordinates`.
"""
_OPTIONAL = ("range_m", "frame", "plane_u_m", "plane_v_m")


def joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate residual tables; their columns `model` and `surface` remain categorical."""
    import pandas as pd
    from pandas.api.types import union_categoricals

    whole = pd.concat(tables, ignore_index=True)
    for name in ("model", "surface"):
        whole[name] = union_categoricals([table[name] for table in tables])
    return whole


def read_residuals(path: Path) -> pd.DataFrame:
    """Read a table of plane residuals (Parquet or CSV) as a data frame with the columns `COLUMNS`.

    Tables of older versions may lack `range_m` and the columns after it. Raises InputError if
    another column is missing.
    """
    from pointkit.tables import read_table

    table = read_table(path)
    missing = [name for name in COLUMNS if name not in table]
    if needed := [name for name in missing if name not in _OPTIONAL]:
        raise InputError(f"{path}: not a residual table, without {', '.join(needed)}")
    return table[[name for name in COLUMNS if name not in missing]]


def about_plane(points: Floats, plane: Plane, origin: Floats) -> dict[str, Floats]:
    """Compute those columns of a residual table that follow from points and their fitted plane.

    Parameters
    ----------
    points
        Measured points, (n, 3), m.
    plane
        The fitted plane, whose normal points to the sensor.
    origin
        Position of the sensor, (3,), m.

    Returns
    -------
    dict
        Columns ``residual_m``, ``range_m``, ``plane_u_m`` and ``plane_v_m``, each (n,) float32, in
        m.
    """
    u, v = plane_coordinates(points, plane, origin).T
    values = {
        "residual_m": plane.distances(points),
        "range_m": np.linalg.norm(points - origin, axis=1),
        "plane_u_m": u,
        "plane_v_m": v,
    }
    return {name: column.astype(np.float32) for name, column in values.items()}


def plane_coordinates(points: Floats, plane: Plane, origin: Floats) -> Floats:
    """Return two-dimensional coordinates of points within a plane, (n, 2), m.

    The first axis is horizontal, and the second points upwards. The origin is the foot of the
    perpendicular from the sensor to the plane.

    Parameters
    ----------
    points
        Points, (n, 3), m.
    plane
        The plane, with its normal towards the sensor.
    origin
        Position of the sensor, (3,), m.
    """
    level = np.cross([0.0, 0.0, 1.0], plane.normal)
    # On a horizontal plane any axis is horizontal.
    level = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(level) < 1e-3 else level
    first = level - (level @ plane.normal) * plane.normal
    first /= np.linalg.norm(first)
    return (points - origin) @ np.column_stack([first, np.cross(plane.normal, first)])
