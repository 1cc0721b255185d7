"""Turns (revolutions of the sensor) in tables of returns, which ``puckbench capture`` writes."""

from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.return_table import UNKNOWN, ReturnTable

_PACKETS = "packets"
"""Entry in the description of tables whose turns are of packets, not messages with clouds."""


def whole_turns(table: ReturnTable) -> list[int]:
    """Return the numbers of the turns of a table that are not cut off.

    They are all turns if there are one or two, or if each turn is a message with a cloud.
    Otherwise, the first and the last turn are taken to be cut off.
    """
    numbers: list[int] = np.unique(table["turn"]).tolist()
    is_cut = len(numbers) > 2 and _PACKETS in table.about
    return numbers[1:-1] if is_cut else numbers


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
