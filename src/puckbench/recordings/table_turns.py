"""Turns (revolutions of the sensor) in tables of returns, which ``puckbench capture`` writes."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.lidar.return_table import UNKNOWN, ReturnTable

_PACKETS, _WHOLE, _RINGS = "packets", "whole_turns", "rings"
"""Entries in the description of a table: the first in those whose turns are of packets, not
messages with clouds; the numbers of the first whole turn and of the turn after the last whole one;
and the ring of each laser. Tables of earlier versions have only the first."""
MOST_RING = 0xFFFF
"""Largest number of a ring."""
_log = logging.getLogger(__name__)


def whole_turns(table: ReturnTable) -> list[int]:
    """Return the numbers of the turns of a table that are not cut off.

    They are all turns if none is whole, or if each turn is a message with a cloud.
    """
    numbers: list[int] = np.unique(table["turn"]).tolist()
    return _whole(table, numbers) or numbers


def tell_cut_turns(path: Path, table: ReturnTable) -> None:
    """Log a warning that names the table's file if its turns are used although none is whole."""
    numbers: list[int] = np.unique(table["turn"]).tolist()
    if numbers and not _whole(table, numbers):
        which = f"turns {numbers[0]} to {numbers[-1]}" if len(numbers) > 1 else "its turn"
        fault = "may be cut off where the recording begins or ends"
        _log.warning("%s: %s %s; they are used, as no other is there", path, which, fault)


def _whole(table: ReturnTable, numbers: list[int]) -> list[int]:
    if _PACKETS not in table.about:
        return numbers
    match table.about.get(_WHOLE):
        case [int(first), int(end)]:
            return [number for number in numbers if first <= number < end]
    return numbers[1:-1]


def rings_of_table(table: ReturnTable) -> NDArray[np.uint16]:
    """Return the ring of each return in a table, (n,).

    This is the rank of its laser by elevation among all lasers of the sensor, 0 for the lowest, or
    the laser's number in messages if it rises with the elevation. In tables of earlier versions
    only the lasers that have returns count.
    """
    rings, lasers = table.about.get(_RINGS), table["laser_id"]
    if not isinstance(rings, list) or not all(_is_ring(each) for each in rings):
        rings = []
    if lasers.min(initial=0) >= 0 and lasers.max(initial=0) < len(rings):
        return np.asarray(np.array(rings, np.uint16)[lasers])
    return ranks(table["elevation"])


def ranks(elevations: Floats) -> NDArray[np.uint16]:
    """Return the rank of each elevation among the different elevations, from 0 for the lowest."""
    return np.unique(elevations, return_inverse=True)[1].astype(np.uint16)


def ranks_of_lasers(elevations: Floats | Sequence[float]) -> NDArray[np.uint16]:
    """Return the rank of each laser by its elevation, (lasers,), from 0 for the lowest.

    `elevations` (lasers,) are in any unit. Lasers with equal ones are ranked in their order.
    """
    return np.argsort(np.argsort(elevations, kind="stable")).astype(np.uint16)


def _is_ring(value: Any) -> bool:
    return isinstance(value, int) and 0 <= value <= MOST_RING


def turn_of_table(table: ReturnTable, number: int) -> ReturnTable:
    """Return the rows of a table that belong to the turn with a number."""
    return table.select(table["turn"] == number)


def cloud_of_table(table: ReturnTable) -> PointCloud:
    """Return a table of returns as a cloud in the sensor's frame, in m.

    Its fields are ``laser_id``, ``timestamp`` in s and, if all are known, ``reflectivity``.
    """
    names = ["laser_id", "timestamp"]
    if (table["reflectivity"] != UNKNOWN).all():
        names.append("reflectivity")
    xyz = np.column_stack([table[axis] for axis in "xyz"])
    return PointCloud(xyz, fields={name: table[name] for name in names})
