"""Range errors from tables of plane residuals.

The range error is the distance of the measured point from the ray's intersection with the fitted
plane. A ray of direction d meets a plane (normal n, distance h from the sensor) at the range r,
where ``1 / r = n d / h``. A small error of the plane changes the range by the scalar product of
``r^2 d`` and three unknown numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

NEEDED = ("distance_m", "surface", "run", "laser_id", "residual_m", "incidence_rad")
PLACE = ("range_m", "frame", "plane_u_m", "plane_v_m")
_NUMBERS = tuple(name for name in (*NEEDED, *PLACE) if name != "surface")
# At this cosine of the incidence a residual of 1 mm is a range error of 20 mm.
_LEAST_COSINE = 0.05
# Azimuth bin of a spot: twice the azimuth step at 600 turns a minute.
SPOT_RAD = np.radians(0.4)

_FEWEST = 100
_PLANE = ["device", "distance_m", "run", "surface"]
_RAY_COLUMNS = ("error", "met", "cosine", "basis_u", "basis_v", "basis_n")
_CELLS = {"frame": ["laser_id", "frame"], "spot": ["surface", "laser_id", "spot"]}

Codes = NDArray[np.int64]


@dataclass(frozen=True)
class Observations:
    """Range errors of n returns on planes that are only known by fits to these returns.

    A cell contains the returns of one laser in one frame (or direction) of one scan. A group is the
    part of a cell on one surface. Returns are sorted by cell and surface. Lasers of different
    devices have different numbers.

    Parameters
    ----------
    error
        Range errors, (n,), m.
    basis
        Derivatives of the error with respect to the three parameters of the surface's plane, (n,
        3).
    features
        Columns 1, squared incidence (rad^2) and range (m), (n, 3): a ray's standard deviation is a
        weighted sum of them.
    groups
        First row of each of g groups, and n, (g + 1,).
    surface, laser, scan, cell
        Numbers of each group's surface, laser, pair of laser and scan, and cell, from 0, (g,).
    laser_ids
        Each laser's number in its sensor.
    devices
        Number of sensors.
    tells_mean
        Whether the lasers' mean bias can be separated from the positions of the planes.
    """

    error: Floats
    basis: Floats
    features: Floats
    groups: Codes
    surface: Codes
    laser: Codes
    scan: Codes
    cell: Codes
    laser_ids: tuple[int, ...]
    devices: int
    tells_mean: bool

    def __len__(self) -> int:
        return len(self.error)

    @property
    def surfaces(self) -> int:
        return int(self.surface.max()) + 1

    @property
    def scans(self) -> int:
        return int(self.scan.max()) + 1

    @property
    def cells(self) -> int:
        return int(self.cell.max()) + 1


def observations(tables: Sequence[pd.DataFrame], *, cells: str = "frame") -> Observations:
    """Compute range errors from tables of plane residuals.

    Parameters
    ----------
    tables
        Tables with the columns `virtual_lidar.residual_table.COLUMNS`, one for each device.
    cells
        ``"frame"`` or ``"spot"``, as in `CalibrationOptions`.

    Raises
    ------
    InputError
        A table lacks a column or has invalid values, or there are fewer than 100 residuals.
    """
    if not tables:
        raise InputError("a calibration needs at least one residual table")
    for table in tables:
        _check(table)
    device = np.repeat(np.arange(len(tables)), [len(table) for table in tables])
    rows = pd.concat([table[[*NEEDED, *PLACE]] for table in tables], ignore_index=True)
    rows = rows.assign(device=device, surface=rows["surface"].astype(str))
    rows = _along_rays(rows)
    rows = rows[rows["cosine"] >= _LEAST_COSINE]
    if len(rows) < _FEWEST:
        raise InputError(f"a calibration needs at least {_FEWEST} residuals, there are {len(rows)}")
    return _grouped(rows, cells)


def _check(table: pd.DataFrame) -> None:
    if missing := [name for name in (*NEEDED, *PLACE) if name not in table]:
        raise InputError(f"the residual table has no {', '.join(missing)}: measure it again")
    for name in _NUMBERS:
        if table[name].dtype.kind not in "fiu":
            raise InputError(f"residual table: {name} has values that are not numbers")
        if not np.isfinite(table[name].to_numpy(dtype=np.float64)).all():
            raise InputError(f"residual table: {name} has a missing or infinite value")
    if (table["range_m"] <= 0).any():
        raise InputError("residual table: range_m has a value that is not above 0")
    if not table["incidence_rad"].between(0, np.pi / 2 + 1e-6).all():
        raise InputError("residual table: incidence_rad has a value that is not from 0 to pi/2")


def _along_rays(rows: pd.DataFrame) -> pd.DataFrame:
    height = _heights(rows)
    values = rows[["plane_u_m", "plane_v_m", "residual_m"]].to_numpy(dtype=np.float64)
    points = values - np.outer(height, [0.0, 0.0, 1.0])
    values_on_rays = np.empty((len(rows), len(_RAY_COLUMNS)))
    planes = _codes(rows, _PLANE)
    for plane in range(int(planes.max()) + 1):
        on_it = planes == plane
        values_on_rays[on_it] = _beyond_regressed_plane(points[on_it])
    return rows.assign(height=height, **dict(zip(_RAY_COLUMNS, values_on_rays.T, strict=True)))


def _heights(rows: pd.DataFrame) -> Floats:
    names = ["range_m", "plane_u_m", "plane_v_m", "residual_m"]
    far, u, v, residual = rows[names].to_numpy(dtype=np.float64).T
    each = np.sqrt(np.maximum(far**2 - u**2 - v**2, 0)) + residual
    keys = [rows[name] for name in _PLANE]
    # A median, since recorded ranges do not start at the sensor's origin.
    return np.asarray(pd.Series(each, rows.index).groupby(keys).transform("median"))


def _beyond_regressed_plane(points: Floats) -> Floats:
    # A regression of heights on the plane's coordinates, not a fit by distance from the plane as in
    # `pointkit.geometry.ransac.least_squares_plane`.
    terms = np.column_stack([np.ones(len(points)), points[:, :2]])
    (offset, *slopes), *_ = np.linalg.lstsq(terms, points[:, 2], rcond=None)
    normal = np.array([-slopes[0], -slopes[1], 1.0])
    far = np.linalg.norm(points, axis=1)
    rays = points / far[:, None]
    met = offset / (rays @ normal)
    cosine = -(rays @ normal) / np.linalg.norm(normal)
    return np.column_stack([far - met, met, cosine, met[:, None] ** 2 * rays])


def _grouped(rows: pd.DataFrame, cells: str) -> Observations:
    scan = ["device", "distance_m", "run"]
    coded = pd.DataFrame(
        {
            "surface": _codes(rows, [*scan, "surface"]),
            "laser": _codes(rows, ["device", "laser_id"]),
            "scan": _codes(rows, [*scan, "laser_id"]),
            "cell": _codes(rows.assign(spot=_spot(rows)), [*scan, *_CELLS[cells]]),
        }
    )
    order = np.lexsort((coded["surface"], coded["cell"]))
    coded, rows = coded.iloc[order], rows.iloc[order]
    is_next = np.diff(coded[["cell", "surface"]].to_numpy(), axis=0).any(axis=1)
    starts = np.concatenate([[0], np.flatnonzero(is_next) + 1])
    error, met = rows[["error", "met"]].to_numpy(dtype=np.float64).T
    angle = rows["incidence_rad"].to_numpy(dtype=np.float64)
    basis = rows[["basis_u", "basis_v", "basis_n"]].to_numpy(dtype=np.float64)
    return Observations(
        error=error,
        basis=_of_rings(basis, coded) if cells == "spot" else basis,
        features=np.column_stack([np.ones(len(rows)), angle**2, met]),
        groups=np.append(starts, len(rows)),
        surface=coded["surface"].to_numpy()[starts],
        laser=coded["laser"].to_numpy()[starts],
        scan=coded["scan"].to_numpy()[starts],
        cell=coded["cell"].to_numpy()[starts],
        laser_ids=tuple(rows.groupby(["device", "laser_id"])["laser_id"].first()),
        devices=int(rows["device"].max()) + 1,
        tells_mean=cells == "frame",
    )


def _of_rings(basis: Floats, coded: pd.DataFrame) -> Floats:
    rings = [coded["surface"].to_numpy(), coded["laser"].to_numpy()]
    return pd.DataFrame(basis).groupby(rings).transform("mean").to_numpy()


def _spot(rows: pd.DataFrame) -> Codes:
    azimuth = np.arctan2(rows["plane_u_m"], rows["height"])
    return np.asarray(np.floor(azimuth / SPOT_RAD), dtype=np.int64)


def _codes(rows: pd.DataFrame, names: list[str]) -> Codes:
    return np.asarray(rows.groupby(names, sort=True).ngroup(), dtype=np.int64)
