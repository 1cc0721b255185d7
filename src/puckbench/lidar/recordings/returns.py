"""Tables of a real sensor's returns, in its coordinate frame, stored as Parquet files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from puckbench.io.return_tables import (
    ColumnSpecs,
    ReturnTable,
    TableSchema,
    read_return_table,
    write_return_table,
)

STRONGEST, LAST, BOTH = 0, 1, 2
"""Kinds of return; BOTH is a single return of a beam in dual return mode."""

RETURN_COLUMNS: ColumnSpecs = {
    "timestamp": ("<f8", "s", "time of firing since the first packet, by the sensor's clock"),
    "turn": ("<i4", "", "turn of the sensor, from 0; a turn begins at azimuth 0"),
    "laser_id": ("<i2", "", "laser, from 0"),
    "return_kind": ("<i2", "", "0 strongest, 1 last, 2 both"),
    "azimuth": ("<f8", "rad", "clockwise from forward (y) seen from above, at the firing"),
    "elevation": ("<f8", "rad", "nominal elevation of the laser"),
    "distance": ("<f8", "m", "measured distance"),
    "reflectivity": ("<i2", "", "0..100 diffuse, 101..255 retro-reflector"),
    "x": ("<f8", "m", "right, sensor's frame"),
    "y": ("<f8", "m", "forward, sensor's frame"),
    "z": ("<f8", "m", "up, sensor's frame, vertical correction applied"),
}


@dataclass(frozen=True)
class RecordedReturns(ReturnTable):
    schema = TableSchema("table of returns", "puckbench_capture", RETURN_COLUMNS)


def write_returns(path: Path, table: RecordedReturns) -> None:
    write_return_table(path, table)


def read_returns(path: Path) -> RecordedReturns:
    return read_return_table(path, RecordedReturns)
