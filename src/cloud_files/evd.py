"""EVD files, the format of the simulator BlenSor."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from pointkit.column_tables import ColumnTable
from pointkit.files import write_bytes

_NUMBERS = (
    *("timestamp", "yaw", "pitch", "distance", "distance_noisy"),
    *("x", "y", "z", "x_noisy", "y_noisy", "z_noisy"),
)
_ROW = np.dtype([("numbers", "<f8", 14), ("object_id", "<u8")])
_WHITE = 255.0


def write_evd(path: str | Path, table: ColumnTable) -> None:
    """Write a table of virtual returns as an EVD file, the format of the simulator BlenSor.

    The file holds one frame. Each return has its time, angles, distances and coordinates (with and
    without noise), the colour white, and the number of the object that it hit (0 if unknown).

    Parameters
    ----------
    path
        The file to write.
    table
        A table with the columns of a `virtual_lidar.ScanTable`.
    """
    rows = np.empty(len(table), dtype=_ROW)
    for place, name in enumerate(_NUMBERS):
        rows["numbers"][:, place] = table[name]
    rows["numbers"][:, len(_NUMBERS) :] = _WHITE
    rows["object_id"] = np.maximum(table["object_id"], 0)
    write_bytes(path, struct.pack("<i", len(rows)) + rows.tobytes() + struct.pack("<i", -1))
