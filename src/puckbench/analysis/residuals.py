"""Plane residuals of virtual scans of a wall and a floor (thesis section 5.1.2, Procedure 1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import union_categoricals

from puckbench.analysis.planes import THRESHOLD_M, ransac_plane
from puckbench.cloud import Floats
from puckbench.errors import InputError
from puckbench.files import written_whole
from puckbench.mesh import Mesh
from puckbench.scenes.calibration import calibration_origin, make_calibration
from puckbench.seeding import generator
from puckbench.sensor import ScanTable, Sensor, Sweep, load_sensor, open_error_model, scan

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
)
"""Columns of a residual table; `residual_m` is positive on the sensor's side of the plane."""


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
    mesh, origin = _facing_the_wall(distance)
    sensor = load_sensor(procedure.sensor)
    names = ("residuals", procedure.model, f"{distance:g} m", f"run {run}")
    model = open_error_model(procedure.model, procedure.options)
    returns = scan(mesh, sensor, procedure.sweep, model, origin, generator(seed, *names, "scan"))
    parts = []
    for surface in SURFACES:
        rng = generator(seed, *names, "plane", surface)
        rows = _of_surface(returns, mesh, surface, distance)
        residuals = _residuals(rows, origin, procedure, rng)
        parts.append(_frame(rows, residuals, sensor, (procedure.model, surface, distance, run)))
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
    """Read a residual table; InputError when it is missing or another file."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        table = pd.read_parquet(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a Parquet table ({error})") from error
    if missing := [name for name in COLUMNS if name not in table]:
        raise InputError(f"{path}: not a residual table, without {', '.join(missing)}")
    return table[list(COLUMNS)]


def _facing_the_wall(distance: float) -> tuple[Mesh, Floats]:
    """The scene and the sensor's place, both turned by half a turn: a sweep looks towards +y."""
    name = f"wall_floor_{distance:g}m"
    mesh, half_turn = make_calibration(name), np.array([-1.0, -1.0, 1.0])
    turned = Mesh(mesh.vertices * half_turn, mesh.triangles, mesh.labels)
    return turned, np.array(calibration_origin(name)) * half_turn


def _of_surface(returns: ScanTable, mesh: Mesh, surface: str, distance: float) -> ScanTable:
    objects = mesh.labels.objects if mesh.labels else ()
    wanted = [number for number, one in enumerate(objects) if one.semantic == surface]
    rows = returns.select(np.isin(returns.object_id, wanted))
    if len(rows) < 3:
        raise InputError(f"at {distance:g} m only {len(rows)} rays hit the {surface}")
    return rows


def _residuals(
    rows: ScanTable, origin: Floats, procedure: Procedure, rng: np.random.Generator
) -> Floats:
    points = rows.xyz_noisy
    plane = ransac_plane(points, rng, threshold_m=procedure.threshold_m, refit=procedure.refit)
    return plane.facing(origin).distances(points)


def _frame(
    rows: ScanTable, residuals: Floats, sensor: Sensor, about: tuple[str, str, float, int]
) -> pd.DataFrame:
    model, surface, distance, run = about
    first = np.zeros(len(rows), dtype=np.int8)
    elevations = np.array(sensor.laser_elevation_deg, dtype=np.float32)
    columns: tuple[Any, ...] = (
        pd.Categorical.from_codes(first, categories=pd.Index([model])),
        pd.Categorical.from_codes(first + SURFACES.index(surface), categories=pd.Index(SURFACES)),
        np.full(len(rows), distance, dtype=np.float32),
        np.full(len(rows), run, dtype=np.int16),
        rows["laser_id"],
        elevations[rows["laser_id"]],
        residuals.astype(np.float32),
        rows["incidence"].astype(np.float32),
    )
    return pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))


def _kept(table: pd.DataFrame, keep: int | None, rng: np.random.Generator) -> pd.DataFrame:
    if keep is None or keep >= len(table):
        return table
    chosen = np.sort(rng.choice(len(table), keep, replace=False))
    return table.iloc[chosen].reset_index(drop=True)
