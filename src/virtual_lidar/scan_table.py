from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.column_tables import (
    ColumnSpecs,
    ColumnTable,
    TableSchema,
    read_column_table,
    write_column_table,
    write_portions,
)
from pointkit.geometry.cloud import Floats
from pointkit.models import Model, parsed

COLUMNS: ColumnSpecs = {
    "timestamp": ("<f8", "s", "time of firing since the start of the sweep"),
    "frame": ("<i4", "", "frame of the sweep, from 0"),
    "laser_id": ("<i2", "", "laser, from 0"),
    "yaw": ("<f8", "rad", "nominal azimuth in the sensor's frame, counter-clockwise from forward"),
    "pitch": ("<f8", "rad", "nominal elevation in the sensor's frame"),
    "distance": ("<f8", "m", "true distance along the nominal ray"),
    "distance_noisy": ("<f8", "m", "measured distance"),
    "x": ("<f8", "m", "true point of the nominal ray on the surface, world"),
    "y": ("<f8", "m", "true point of the nominal ray on the surface, world"),
    "z": ("<f8", "m", "true point of the nominal ray on the surface, world"),
    "x_noisy": ("<f8", "m", "measured point, world"),
    "y_noisy": ("<f8", "m", "measured point, world"),
    "z_noisy": ("<f8", "m", "measured point, world"),
    "incidence": ("<f8", "rad", "angle between nominal ray and true normal"),
    "object_id": ("<i4", "", "object at the true point, -1: no labels"),
    "primitive_id": ("<i4", "", "geometric primitive at the true point, -1: no labels"),
    "triangle_id": ("<i4", "", "triangle of the mesh at the true point"),
    "nx": ("<f8", "1", "true unit normal at the true point, turned to the sensor"),
    "ny": ("<f8", "1", "true unit normal at the true point, turned to the sensor"),
    "nz": ("<f8", "1", "true unit normal at the true point, turned to the sensor"),
}


class _ScanMetadata(Model, extra="ignore"):
    sensor: Mapping[str, Any] = {}
    sweep: Mapping[str, Any] = {}
    origin: tuple[float, float, float] | None = None
    errors: Mapping[str, Any] = {}


@dataclass(frozen=True)
class ScanTable(ColumnTable):
    """Returns of a virtual scan in the order of firing, each with true and measured values.

    ``table["yaw"]`` is a column as an array (n,); `COLUMNS` has the type, unit and description of
    every column. The inherited property ``xyz`` has the true points (n, 3). ``about`` is a
    dictionary with the parameters of the sensor (``sensor``), of the sweep (``sweep``) and of the
    error model (``errors``), and with the sensor's position (``origin``).
    """

    schema = TableSchema("scan table", "puckbench", COLUMNS)

    @property
    def xyz_noisy(self) -> Floats:
        """Measured points in world coordinates, (n, 3), m."""
        return self.vectors("x_noisy", "y_noisy", "z_noisy")

    @property
    def normals(self) -> Floats:
        """Unit normals (n, 3) of the surface at the true points, on the sensor's side."""
        return self.vectors("nx", "ny", "nz")

    @property
    def object_id(self) -> NDArray[np.int32]:
        """Number (n,) of the mesh's object at each true point; -1 if the mesh has no labels."""
        return self.columns["object_id"]

    @property
    def primitive_id(self) -> NDArray[np.int32]:
        """Number (n,) of the mesh's geometric primitive at each true point; -1 without labels."""
        return self.columns["primitive_id"]


def write_scan(path: Path, table: ScanTable) -> None:
    """Write a scan to a Parquet file, with the unit and description of each column."""
    write_column_table(path, table)


def write_scan_portions(path: Path, portions: Iterator[ScanTable]) -> int:
    """Write the tables of one scan to one Parquet file as they arrive; return its number of rows.

    Parameters
    ----------
    path
        The Parquet file.
    portions
        Tables of successive frames, from `ScanJob.portions`.
    """
    return write_portions(path, portions)


def read_scan(path: Path) -> ScanTable:
    """Return the table that `write_scan` wrote to a file; raise InputError for any other file."""
    table = read_column_table(path, ScanTable)
    parsed(_ScanMetadata, table.about, f"{path}: its metadata")
    return table
