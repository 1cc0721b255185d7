"""The scan table: one row per return, clean and noisy values of the same rays; Parquet on disk."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.errors import InputError
from puckbench.files import written_whole

# name: (type, unit, meaning); the order is the order in the file.
COLUMNS: dict[str, tuple[str, str, str]] = {
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


@dataclass(frozen=True)
class ScanTable:
    """Returns of a scan: arrays of equal length, named as in `COLUMNS`, and how they were made."""

    columns: dict[str, NDArray[Any]]
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["distance"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def xyz(self) -> Floats:
        """True points in world coordinates, m, (n, 3)."""
        return np.column_stack([self.columns[axis] for axis in "xyz"])

    @property
    def xyz_noisy(self) -> Floats:
        """Measured points in world coordinates, m, (n, 3)."""
        return np.column_stack([self.columns[f"{axis}_noisy"] for axis in "xyz"])

    @property
    def normals(self) -> Floats:
        """True unit normals at the true points, turned to the sensor, (n, 3)."""
        return np.column_stack([self.columns[f"n{axis}"] for axis in "xyz"])

    @property
    def object_id(self) -> NDArray[np.int32]:
        """Object at the true point, (n,), -1 without labels."""
        return self.columns["object_id"]

    @property
    def primitive_id(self) -> NDArray[np.int32]:
        """Geometric primitive at the true point, (n,), -1 without labels."""
        return self.columns["primitive_id"]

    def select(self, rows: NDArray[Any]) -> ScanTable:
        """The given rows (mask, indices or slice)."""
        return ScanTable({name: column[rows] for name, column in self.columns.items()}, self.about)


def empty_columns(rows: int) -> dict[str, NDArray[Any]]:
    """Columns with room for `rows` returns, their values undefined."""
    return {name: np.empty(rows, dtype=kind) for name, (kind, _, _) in COLUMNS.items()}


def write_scan(path: Path, table: ScanTable) -> None:
    """Write a Parquet file; each column's metadata has its ``unit`` and ``description``.

    `about` stands as JSON in the schema's metadata under ``puckbench``.
    """
    from pyarrow import parquet

    with written_whole(path) as temporary:
        parquet.write_table(_rows(table), temporary, **_encoding())


def write_scan_portions(path: Path, portions: Iterator[ScanTable]) -> int:
    """Write a scan that comes in portions, each its own row group; the number of its rows.

    One portion is in memory at a time; the first one's `about` is the file's. Raises ValueError
    for no portion; whatever `portions` raises leaves no file.
    """
    from pyarrow import parquet

    first = next(portions, None)
    if first is None:
        raise ValueError("a scan without a portion")
    opening, count = _rows(first), len(first)
    with (
        written_whole(path) as temporary,
        parquet.ParquetWriter(temporary, opening.schema, **_encoding()) as writer,
    ):
        writer.write_table(opening, row_group_size=count)
        del first, opening
        for portion in portions:
            writer.write_table(_rows(portion, writer.schema), row_group_size=len(portion))
            count += len(portion)
    return count


def _rows(table: ScanTable, schema: Any = None) -> Any:
    """The table for Arrow, its `about` in the schema's metadata unless a schema is given."""
    import pyarrow as pa

    if schema is None:
        about = json.dumps(table.about, sort_keys=True, allow_nan=False)
        schema = pa.schema([_field(name) for name in COLUMNS]).with_metadata({"puckbench": about})
    return pa.table([pa.array(table[name]) for name in COLUMNS], schema=schema)


def _encoding() -> dict[str, Any]:
    floats = [name for name, (kind, _, _) in COLUMNS.items() if kind == "<f8"]
    whole = [name for name in COLUMNS if name not in floats]
    return {"compression": "zstd", "use_byte_stream_split": floats, "use_dictionary": whole}


def read_scan(path: Path) -> ScanTable:
    """Read a scan table; InputError when it is missing, damaged or lacks a column."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        rows = parquet.read_table(path)
    except (OSError, pa.ArrowException) as error:
        reason = "no such file" if not path.exists() else "not a readable Parquet file"
        raise InputError(f"{path}: {reason}") from error
    missing = [name for name in COLUMNS if name not in rows.column_names]
    if missing:
        raise InputError(f"{path}: not a scan table, it lacks {', '.join(missing)}")
    about = json.loads((rows.schema.metadata or {}).get(b"puckbench", b"{}"))
    return ScanTable({name: _column(rows, name) for name in COLUMNS}, about)


def _column(rows: Any, name: str) -> NDArray[Any]:
    kind, _, _ = COLUMNS[name]
    values: NDArray[Any] = rows.column(name).to_numpy()
    return values.astype(kind, copy=False)


def _field(name: str) -> Any:
    import pyarrow as pa

    kind, unit, description = COLUMNS[name]
    metadata = {"unit": unit, "description": description}
    return pa.field(name, pa.from_numpy_dtype(np.dtype(kind)), nullable=False, metadata=metadata)
