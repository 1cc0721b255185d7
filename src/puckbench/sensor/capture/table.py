"""The capture table: one row per return of a real sensor, in the sensor's own frame; Parquet."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.errors import InputError
from puckbench.files import written_whole

STRONGEST, LAST, BOTH = 0, 1, 2
"""Kinds of return: BOTH is the only return of a beam that was asked for two."""

# name: (type, unit, meaning); the order is the order in the file.
CAPTURE_COLUMNS: dict[str, tuple[str, str, str]] = {
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
class CaptureTable:
    """Returns in the order of firing: arrays of equal length, named as in `CAPTURE_COLUMNS`."""

    columns: dict[str, NDArray[Any]]
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["distance"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def xyz(self) -> Floats:
        """Points in the sensor's frame (x right, y forward, z up), m, (n, 3)."""
        return np.column_stack([self.columns[axis] for axis in "xyz"])

    def select(self, rows: NDArray[Any]) -> CaptureTable:
        """The given rows (mask, indices or slice)."""
        return CaptureTable({name: part[rows] for name, part in self.columns.items()}, self.about)


def write_capture_table(path: Path, table: CaptureTable) -> None:
    """Write a Parquet file with units in the columns' metadata and `about` in the schema's."""
    import pyarrow as pa
    from pyarrow import parquet

    fields = [
        pa.field(name, pa.from_numpy_dtype(np.dtype(kind)), False, _metadata(unit, meaning))
        for name, (kind, unit, meaning) in CAPTURE_COLUMNS.items()
    ]
    about = json.dumps(table.about, sort_keys=True, allow_nan=False)
    schema = pa.schema(fields).with_metadata({"puckbench_capture": about})
    rows = pa.table([pa.array(table[name]) for name in CAPTURE_COLUMNS], schema=schema)
    with written_whole(path) as temporary:
        parquet.write_table(rows, temporary, compression="zstd")


def read_capture_table(path: Path) -> CaptureTable:
    """Read what `write_capture_table` wrote; InputError when it is missing or something else."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        rows = parquet.read_table(path)
    except (OSError, pa.ArrowException) as error:
        reason = "no such file" if not path.exists() else "not a readable Parquet file"
        raise InputError(f"{path}: {reason}") from error
    missing = [name for name in CAPTURE_COLUMNS if name not in rows.column_names]
    if missing:
        raise InputError(f"{path}: not a capture table, it lacks {', '.join(missing)}")
    about = json.loads((rows.schema.metadata or {}).get(b"puckbench_capture", b"{}"))
    columns = {
        name: rows.column(name).to_numpy().astype(kind, copy=False)
        for name, (kind, _, _) in CAPTURE_COLUMNS.items()
    }
    return CaptureTable(columns, about)


def _metadata(unit: str, meaning: str) -> dict[str, str]:
    return {"unit": unit, "description": meaning}
