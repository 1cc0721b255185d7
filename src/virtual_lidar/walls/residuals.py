"""Distances of a recording's returns from fitted planes (thesis, section 5.1.2, Procedure 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats
from pointkit.geometry.ransac import ransac_plane
from pointkit.lidar.return_table import BOTH, ReturnTable
from pointkit.lidar.times import TimeUnit
from pointkit.models import Model, parsed
from pointkit.seeding import generator
from virtual_lidar.residual_table import COLUMNS, REAL, SURFACES, about_plane
from virtual_lidar.walls.detection import (
    DetectedPlane,
    PlaneSearch,
    Rejected,
    find_surfaces,
    incidence,
    kind_of,
    surface_of,
)
from virtual_lidar.walls.stillness import SHIFT_M, Still, still_rows


class Crop(Model):
    """A wall, floor or ceiling in a recording that the user selects with a box.

    Parameters
    ----------
    surface
        Whether the plane is a wall, a floor or a ceiling.
    box
        Lowest and highest corner, (x, y, z), m, of a box in sensor coordinates. The box must
        contain returns of this plane only.
    """

    surface: Literal["wall", "floor", "ceiling"]
    box: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _of_two_corners(self) -> Self:
        if len(self.box) != 2 or any(len(corner) != 3 for corner in self.box):
            raise InputError("box must be two corners of three numbers, [[x, y, z], [x, y, z]]")
        if not np.all(np.less(*self.box)):
            raise InputError("each number of the box's first corner must be below the second's")
        return self

    def rows(self, points: Floats) -> NDArray[np.intp]:
        """Return the indices of the points, (n, 3), m, that are in the box."""
        low, high = np.array(self.box)
        return np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))


class RecordingOptions(Model):
    """Options that say how the plane residuals of a recording are computed.

    A plane residual is the distance of a return from the plane that was fitted to its surface.

    Parameters
    ----------
    sensor
        Name or YAML file of the sensor; by default the packets' sensor.
    stream
        Stream of a packet capture with several sensors, such as ``192.168.1.201:2368``.
    topic
        Topic with the sensor's messages in a ROS bag.
    time_unit
        Unit of the times of a cloud, ``s``, ``ms``, ``us`` or ``ns``; by default inferred.
    still_s
        ``[start, end]`` of the interval to use, seconds after the first packet; by default the
        longest interval at rest.
    most_shift_m
        Largest difference of distances, m, between two turns (revolutions) of the sensor that
        counts as rest.
    most_turns
        Largest number of turns (revolutions) to use, from the start of the interval.
    planes
        Planes selected by hand, each ``{"surface": "wall", "box": [[x, y, z], [x, y, z]]}``: a
        `wall`, `floor` or `ceiling`, and the lowest and highest corner, m, of a box in sensor
        coordinates (x right, y forward, z up) that excludes the edges. By default, planes are
        detected.
    search
        Criteria for detected planes; `inlier_sigmas`, `most_incidence_deg`, `least_laser_share` and
        `tilt_deg` are also used for planes selected by hand.
    """

    sensor: str | None = None
    stream: str | None = None
    topic: str | None = None
    time_unit: TimeUnit | None = None
    still_s: tuple[float, ...] | None = None
    most_shift_m: PositiveFloat = SHIFT_M
    most_turns: PositiveInt = 100
    planes: Annotated[tuple[Crop, ...], Field(min_length=1)] | None = None
    search: PlaneSearch = PlaneSearch()

    @model_validator(mode="after")
    def _of_an_interval(self) -> Self:
        if self.still_s is not None and (
            len(self.still_s) != 2 or not 0 <= self.still_s[0] < self.still_s[1]
        ):
            raise InputError("still_s must be [start, end] in seconds, 0 or later, start first")
        return self


def recording_options(values: Mapping[str, Any]) -> RecordingOptions:
    """Create the options from a dictionary; raise InputError for an unknown or invalid field."""
    return parsed(RecordingOptions, values, "capture options")


# For planes chosen by hand; others have the limits of `PlaneSearch`.
_LEAST_RETURNS = 50


@dataclass(frozen=True)
class RecordedPlanes:
    """The planes found in a recording, and that part of it in which the sensor was at rest.

    Parameters
    ----------
    table
        Returns of this part.
    still
        The time in which the sensor was at rest, if it was detected; None if the option `still_s`
        gave it.
    surfaces
        Planes that are used. Planes that were selected by hand are in the order of the option
        `planes`; detected planes come in decreasing number of returns.
    rejected
        Detected planes that are not used, with the reasons.
    """

    table: ReturnTable
    still: Still | None
    surfaces: list[DetectedPlane]
    rejected: list[Rejected]


def recorded_planes(table: ReturnTable, options: RecordingOptions, source: Path) -> RecordedPlanes:
    """Find when the sensor of a recording was at rest, and the walls, floors and ceilings it saw.

    In dual return mode (two returns reported per laser beam), only beams with two equal returns are
    used, since other beams hit an edge.

    Parameters
    ----------
    table
        Returns of the recording. If the option `still_s` is given, it must contain the returns of
        that interval only.
    options
        Options, from `recording_options`.
    source
        The file that error messages name.

    Returns
    -------
    RecordedPlanes
        The returns of the sensor at rest, and the planes in them.

    Raises
    ------
    InputError
        The sensor was never at rest, no plane was found, or a box selected by hand contains no such
        plane.
    """
    still = None
    with naming(source):
        if options.still_s is None:
            table, still = still_rows(table, options.most_shift_m)
        table = table.select(table["turn"] < table["turn"].min() + options.most_turns)
        if (table["return_kind"] == BOTH).any():
            table = table.select(table["return_kind"] == BOTH)
        surfaces, rejected = _planes(table, options)
    return RecordedPlanes(table, still, surfaces, rejected)


def recording_residuals(planes: RecordedPlanes) -> pd.DataFrame:
    """Return the plane residuals of a recording as a table with the columns `COLUMNS`.

    A plane residual is the distance of a return from its plane. The column `run` has the number of
    the plane, from 1, and the column `frame` the number of the revolution.
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


def _planes(
    table: ReturnTable, options: RecordingOptions
) -> tuple[list[DetectedPlane], list[Rejected]]:
    if options.planes:
        chosen = [
            _cropped(table, crop, options.search, number)
            for number, crop in enumerate(options.planes, 1)
        ]
        return chosen, []
    # Planes of real data must not depend on the seed of a run.
    surfaces, rejected = find_surfaces(table, options.search, generator(0, "capture", "planes"))
    if not surfaces:
        raise InputError(f"no plane of a wall, floor or ceiling {_why(rejected)}")
    return surfaces, rejected


def _cropped(table: ReturnTable, crop: Crop, search: PlaneSearch, number: int) -> DetectedPlane:
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
    most = max(rejected, key=lambda plane: len(plane.surface.rows))
    place = f"{most.surface.kind} at {most.surface.distance_m:.2f} m"
    return f"(the largest of {len(rejected)} not taken: {place}, {most.reason})"


def _rows_of(rows: ReturnTable, surface: DetectedPlane, number: int) -> pd.DataFrame:
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
