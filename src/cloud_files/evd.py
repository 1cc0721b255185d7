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


def write_evd(path: Path, table: ColumnTable) -> None:
    """Write a block of BlenSor's EVD format: per return, 11 numbers, white and the object index."""
    rows = np.empty(len(table), dtype=_ROW)
    for place, name in enumerate(_NUMBERS):
        rows["numbers"][:, place] = table[name]
    rows["numbers"][:, len(_NUMBERS) :] = _WHITE
    rows["object_id"] = np.maximum(table["object_id"], 0)
    write_bytes(path, struct.pack("<i", len(rows)) + rows.tobytes() + struct.pack("<i", -1))
