"""Plane residuals of virtual scans of a wall and a floor (thesis section 5.1.2, Procedure 1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import union_categoricals

from puckbench.core.errors import InputError
from puckbench.core.files import written_whole
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.geometry.ransac import THRESHOLD_M, Plane, ransac_plane
from puckbench.lidar import ScanTable, Sensor, Sweep, load_sensor, open_error_model, scan
from puckbench.scenes.calibration import facing_the_wall

SURFACES = ("wall", "floor")
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

`range_m` is the distance from the sensor to the measured point, `frame` the frame of the scan (the
turn of a capture); `plane_u_m`, `plane_v_m` are those of `plane_coordinates`. These four came
later: an older table, which figures still take, has none.
"""
_LATER = ("range_m", "frame", "plane_u_m", "plane_v_m")


SWEEP = Sweep(frames_skipped=1)
"""The 4 s sweep of the thesis's error scans; its last frame is keyed but not scanned."""


@dataclass(frozen=True)
class Procedure:
    """How residuals are measured; the defaults are the thesis's set-up.

    `keep` bounds the rows of a scan that go into the table, chosen at random; the planes are
    always fitted to all points.
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
    """Residuals of `runs` scans at each distance, m; columns as in `COLUMNS`.

    A scan depends on the seed, the model's name, its distance and its run (from 1) alone. Raises
    InputError for a distance that no calibration scene has, an unknown model, or no scan at all.
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
    """Residuals of one scan, wall before floor, each in the order of firing.

    Points belong to the surface that their nominal ray hits, so that no noise is cropped away.
    """
    mesh, origin = facing_the_wall(distance)
    sensor = load_sensor(procedure.sensor)
    names = ("residuals", procedure.model, f"{distance:g} m", f"run {run}")
    model = open_error_model(procedure.model, procedure.options)
    returns = scan(mesh, sensor, procedure.sweep, model, origin, generator(seed, *names, "scan"))
    parts = []
    for surface in SURFACES:
        rng = generator(seed, *names, "plane", surface)
        rows = _of_surface(returns, mesh, surface, distance)
        about = about_plane(rows.xyz_noisy, _plane(rows, origin, procedure, rng), origin)
        parts.append(_frame(rows, about, sensor, (procedure.model, surface, distance, run)))
    table = joined(parts)
    return _kept(table, procedure.keep, generator(seed, *names, "keep"))


def joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Residual tables one after the other, models and surfaces still categories."""
    whole = pd.concat(tables, ignore_index=True)
    for name in ("model", "surface"):
        whole[name] = union_categoricals([table[name] for table in tables])
    return whole


def write_residuals(path: Path, table: pd.DataFrame) -> None:
    """Write a residual table as Parquet."""
    with written_whole(path) as temporary:
        table.to_parquet(temporary, compression="zstd", index=False)


def read_residuals(path: Path) -> pd.DataFrame:
    """Read a residual table; InputError when it is missing or another file.

    The columns of a table written before `range_m` and those after it were there are fewer.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        table = pd.read_parquet(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a Parquet table ({error})") from error
    missing = [name for name in COLUMNS if name not in table]
    if needed := [name for name in missing if name not in _LATER]:
        raise InputError(f"{path}: not a residual table, without {', '.join(needed)}")
    return table[[name for name in COLUMNS if name not in missing]]


def about_plane(points: Floats, plane: Plane, origin: Floats) -> dict[str, Floats]:
    """What a residual table tells of points (n, 3), m, and a plane fitted to them, by column.

    origin: (3,), where the sensor stands, on the side that the plane's normal points to.
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
    """Where points (n, 3) are in a plane, m, (n, 2): from the foot of the sensor's perpendicular.

    The first axis is level, the second goes up the plane's slope. Another plane near this one is at
    a distance of ``a + b u + c v`` from it: that is how a calibration takes the fit back.
    """
    level = np.cross([0.0, 0.0, 1.0], plane.normal)
    # Any axis will do on a level plane.
    level = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(level) < 1e-3 else level
    first = level - (level @ plane.normal) * plane.normal
    first /= np.linalg.norm(first)
    return (points - origin) @ np.column_stack([first, np.cross(plane.normal, first)])


def _of_surface(returns: ScanTable, mesh: Mesh, surface: str, distance: float) -> ScanTable:
    objects = mesh.labels.objects if mesh.labels else ()
    wanted = [number for number, one in enumerate(objects) if one.semantic == surface]
    rows = returns.select(np.isin(returns.object_id, wanted))
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
    rows: ScanTable,
    about: dict[str, Floats],
    sensor: Sensor,
    what: tuple[str, str, float, int],
) -> pd.DataFrame:
    model, surface, distance, run = what
    first = np.zeros(len(rows), dtype=np.int8)
    elevations = np.array(sensor.laser_elevation_deg, dtype=np.float32)
    columns: dict[str, Any] = {
        "model": pd.Categorical.from_codes(first, categories=pd.Index([model])),
        "surface": pd.Categorical.from_codes(
            first + SURFACES.index(surface), categories=pd.Index(SURFACES)
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


def _kept(table: pd.DataFrame, keep: int | None, rng: np.random.Generator) -> pd.DataFrame:
    if keep is None or keep >= len(table):
        return table
    chosen = np.sort(rng.choice(len(table), keep, replace=False))
    return table.iloc[chosen].reset_index(drop=True)
