"""Plane residuals of a real capture: Procedure 1 of the thesis (section 5.1.2) on what is there.

The interval in which the sensor stood still, its planes, and the signed distances of the returns
to them, as the residuals of virtual scans have them, with the statistics that only repeated turns
of a real sensor give.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.geometry.ransac import ransac_plane
from puckbench.lidar import load_sensor
from puckbench.lidar.recordings import CaptureTable, read_capture
from puckbench.lidar.recordings.capture_table import BOTH
from puckbench.lidar.residual_table import COLUMNS, REAL, SURFACES, about_plane
from puckbench.lidar.walls.detection import (
    PlaneSearch,
    Rejected,
    Surface,
    find_surfaces,
    incidence,
    kind_of,
    surface_of,
)
from puckbench.lidar.walls.options import CaptureOptions, Crop
from puckbench.lidar.walls.ray_statistics import range_deviation
from puckbench.lidar.walls.stillness import Still, still_rows

# Of a plane chosen by hand; one that is found has the limits of `PlaneSearch`.
_LEAST_RETURNS = 50


@dataclass(frozen=True)
class CapturedPlanes:
    """The returns of a capture that count, where it stood still, and the planes in it.

    still: None when the interval was given.
    """

    table: CaptureTable
    still: Still | None
    surfaces: list[Surface]
    rejected: list[Rejected]

    def deviations(self, surface: Surface) -> tuple[CaptureTable, Floats]:
        """The rows of a surface, and what their ranges are longer than the plane's, m, (n,)."""
        rows = self.table.select(surface.rows)
        residuals = surface.plane.distances(rows.xyz)
        return rows, range_deviation(residuals, incidence(rows, surface.plane))


def captured_planes(path: Path, options: CaptureOptions) -> CapturedPlanes:
    """Read a capture, choose its still interval, and find its planes (or crop to those given).

    Of a dual capture only the beams with a single return count: the others straddle an edge.
    Raises InputError, one line that names the file, for a capture that cannot be read, that never
    stands still, or that has no plane.
    """
    sensor = load_sensor(options.sensor) if options.sensor else None
    start, end = options.still_s or (0.0, math.inf)
    table, still = read_capture(path, sensor, start, end), None
    try:
        if options.still_s is None:
            table, still = still_rows(table, options.most_shift_m)
        table = table.select(table["turn"] < table["turn"].min() + options.most_turns)
        if (table["return_kind"] == BOTH).any():
            table = table.select(table["return_kind"] == BOTH)
        surfaces, rejected = _planes(table, options)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return CapturedPlanes(table, still, surfaces, rejected)


def capture_residuals(planes: CapturedPlanes) -> pd.DataFrame:
    """Residual table of a capture, columns as `residuals.COLUMNS`.

    The model is `REAL`; distance_m is the plane's distance from the sensor, rounded to 1 cm; run
    is the number of the plane from 1; frame is the turn of the sensor; range_m is as measured.
    """
    parts = [
        _rows_of(planes.table.select(surface.rows), surface, number)
        for number, surface in enumerate(planes.surfaces, 1)
    ]
    table = pd.concat(parts, ignore_index=True)
    kinds = [*SURFACES, *sorted(set(table["surface"]) - set(SURFACES))]
    table["surface"] = pd.Categorical(table["surface"], categories=kinds)
    table["model"] = pd.Categorical(table["model"])
    return table[list(COLUMNS)]


def _planes(table: CaptureTable, options: CaptureOptions) -> tuple[list[Surface], list[Rejected]]:
    """The planes chosen by hand, or those found; InputError when there are none."""
    if options.planes:
        chosen = [
            _cropped(table, crop, options.search, number)
            for number, crop in enumerate(options.planes, 1)
        ]
        return chosen, []
    # The planes found do not depend on a run's seed: what is real is not drawn at random.
    surfaces, rejected = find_surfaces(table, options.search, generator(0, "capture", "planes"))
    if not surfaces:
        raise InputError(f"no plane of a wall, floor or ceiling {_why(rejected)}")
    return surfaces, rejected


def _cropped(table: CaptureTable, crop: Crop, search: PlaneSearch, number: int) -> Surface:
    """The plane of the returns in a box, fitted as those that are found."""
    rows, what = crop.rows(table.xyz), f"plane {number} ({crop.surface})"
    if len(rows) < _LEAST_RETURNS:
        least = f"where at least {_LEAST_RETURNS} are needed"
        raise InputError(f"{what}: {len(rows)} returns of the still interval in its box, {least}")
    rng = generator(0, "capture", what)
    start = ransac_plane(table.xyz[rows], rng, threshold_m=search.threshold_m, refit=True)
    surface = surface_of(table, rows, start, crop.surface, search)
    if len(surface.rows) < _LEAST_RETURNS:
        raise InputError(
            f"{what}: only {len(surface.rows)} returns on it below the incidence limit"
        )
    if kind_of(surface.plane, search) != crop.surface:
        raise InputError(f"{what}: the plane in its box is {kind_of(surface.plane, search)}")
    return surface


def _why(rejected: list[Rejected]) -> str:
    if not rejected:
        return "with enough returns"
    most = max(rejected, key=lambda one: len(one.surface.rows))
    place = f"{most.surface.kind} at {most.surface.distance_m:.2f} m"
    return f"(the largest of {len(rejected)} not taken: {place}, {most.reason})"


def _rows_of(rows: CaptureTable, surface: Surface, number: int) -> pd.DataFrame:
    about = about_plane(rows.xyz, surface.plane, np.zeros(3))
    columns = {
        **about,
        "model": REAL,
        "surface": surface.kind,
        "distance_m": np.float32(round(surface.distance_m, 2)),
        "run": np.int16(number),
        "laser_id": rows["laser_id"],
        "elevation_deg": np.degrees(rows["elevation"]).astype(np.float32),
        "incidence_rad": incidence(rows, surface.plane).astype(np.float32),
        "range_m": rows["distance"].astype(np.float32),
        "frame": rows["turn"],
    }
    return pd.DataFrame({name: columns[name] for name in COLUMNS})
