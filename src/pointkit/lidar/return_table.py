"""Tables that have one row for each return of a spinning sensor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.column_tables import ColumnSpecs, ColumnTable, TableSchema, read_column_table
from pointkit.errors import InputError
from pointkit.lidar.returns import HOUR_US, Returns
from pointkit.lidar.turns import Turn, elapsed

STRONGEST, LAST, BOTH = 0, 1, 2
"""Kinds of return; in dual return mode, BOTH is a return that is strongest and last."""
UNKNOWN = -1
"""Reflectivity that is not known."""

RETURN_COLUMNS: ColumnSpecs = {
    "timestamp": ("<f8", "s", "time of firing since the first packet, by the sensor's clock"),
    "turn": ("<i4", "", "turn of the sensor, from 0; begins with the packet that passes azimuth 0"),
    "laser_id": ("<i2", "", "laser, from 0"),
    "return_kind": ("<i2", "", "0 strongest, 1 last, 2 both"),
    "azimuth": ("<f8", "rad", "clockwise from forward (y) seen from above, at the firing"),
    "elevation": ("<f8", "rad", "nominal elevation of the laser"),
    "distance": ("<f8", "m", "measured distance"),
    "reflectivity": ("<i2", "", "0..100 diffuse, 101..255 retro-reflector; -1: not known"),
    "x": ("<f8", "m", "right, sensor's frame"),
    "y": ("<f8", "m", "forward, sensor's frame"),
    "z": ("<f8", "m", "up, sensor's frame, vertical correction applied"),
}

FURTHER_COLUMNS: ColumnSpecs = {
    "signal": ("<i4", "photons", "strength of the return"),
    "near_infrared": ("<i4", "photons", "ambient light at the laser's wavelength"),
    "column": ("<i4", "", "firing column of the turn, from 0; the sensor's measurement id"),
    "clock_time": ("<i8", "ns", "time of firing on the sensor's clock; since 1970 if it is set"),
}
"""Columns that only tables of some sensors (Ouster) have."""


@dataclass(frozen=True)
class ReturnTable(ColumnTable):
    """Table of the returns of a sensor: the time, laser, angles, distance and point of each return.

    `RETURN_COLUMNS` has the type, unit and description of each column, and `FURTHER_COLUMNS` those
    of columns that only some sensors have. Laser firings without a return have no row.
    """

    schema = TableSchema("table of returns", "puckbench_capture", RETURN_COLUMNS, FURTHER_COLUMNS)


def return_table_of(returns: Returns, sequence_us: float = 0.0) -> ReturnTable:
    """Convert returns from the integers that the sensor reports to a table of points.

    The rows are in the order of `Returns.points`.

    Parameters
    ----------
    returns
        The returns, of at least one revolution.
    sequence_us
        Time between successive columns of a data packet, microseconds. The time of a packet is that
        of its first column. Returns of packets without a time get the time 0.

    Returns
    -------
    ReturnTable
        The table. Its ``about`` has the name of the sensor (``sensor``) and, for each of its
        lasers, the rank by elevation (``rings``), 0 for the lowest.
    """
    parts = [_rows(returns, turn, sequence_us) for turn in returns.turns]
    counts = [len(part["laser_id"]) for part in parts]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    packets = elapsed(columns["packet_us"], HOUR_US)
    columns["timestamp"] = (packets[: sum(counts)] + columns["delay_us"]) * 1e-6
    columns["turn"] = np.repeat(np.arange(len(parts)), counts)
    columns |= dict(zip("xyz", returns.points().T, strict=True))
    kinds = RETURN_COLUMNS.items()
    table = {name: columns[name].astype(kind, copy=False) for name, (kind, *_) in kinds}
    rings = np.argsort(returns.layout.order).tolist()
    return ReturnTable(table, {"sensor": returns.sensor, "rings": rings})


def _rows(returns: Returns, turn: Turn, sequence_us: float) -> dict[str, NDArray[Any]]:
    layout, beams, unknown = returns.layout, returns.beams, np.full(turn.ranges.shape, UNKNOWN)
    columns, lasers, kinds = returns.indices(turn)
    at = (kinds, columns, lasers)
    is_only = turn.ranges[0, columns, lasers] == turn.ranges[-1, columns, lasers]
    times = np.zeros(1) if turn.times is None else turn.times.astype(np.float64)
    packets, column = np.divmod(columns, layout.columns_per_block * layout.blocks_per_time)
    values = unknown if turn.reflectivities is None else turn.reflectivities
    return {
        "packet_us": times[packets % len(times)],
        "delay_us": sequence_us * (column + np.asarray(beams.delays)[lasers]),
        "laser_id": lasers,
        "return_kind": np.where(is_only & (layout.kinds == 2), BOTH, kinds),
        "azimuth": np.mod(returns.azimuths(turn)[columns, lasers], 2 * np.pi),
        "elevation": np.radians(beams.elevations_deg)[lasers],
        "distance": returns.distances(turn)[at],
        "reflectivity": values[at],
    }


def read_return_table(path: Path) -> ReturnTable:
    """Read a `ReturnTable` from its Parquet file.

    Raises
    ------
    InputError
        The file cannot be read as such a table, or holds a value that is not finite.
    """
    table = read_column_table(path, ReturnTable)
    for name, values in table.columns.items():
        if not np.isfinite(values).all():
            raise InputError(f"{path}: column {name} has a value that is not finite")
    return table
