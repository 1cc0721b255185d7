"""Points in PLY, PCD and CSV, each return with its laser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.files import write_bytes, written_whole

Rows = NDArray[Any]
"""A structured array; x, y, z, timestamp and laser_id are among its names."""

_PCD_HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {fields}
SIZE {sizes}
TYPE {types}
COUNT {counts}
WIDTH {points}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {points}
DATA binary
"""


def write_ply(path: Path, rows: Rows) -> None:
    """Binary little-endian PLY, one property per column."""
    from plyfile import PlyData, PlyElement

    with written_whole(path) as temporary:
        PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(temporary))


def write_pcd(path: Path, rows: Rows) -> None:
    """Binary PCD: x, y, z (float32), label (the laser, as PCL's PointXYZL has it), timestamp."""
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4"), ("timestamp", "<f8")]
    points = np.empty(len(rows), dtype=kinds)
    for name in ("x", "y", "z", "timestamp"):
        points[name] = rows[name]
    points["label"] = rows["laser_id"]
    formats = [np.dtype(kind) for _, kind in kinds]
    header = _PCD_HEADER.format(
        fields=" ".join(name for name, _ in kinds),
        sizes=" ".join(str(kind.itemsize) for kind in formats),
        types=" ".join(kind.kind.upper() for kind in formats),
        counts=" ".join("1" for _ in kinds),
        points=len(points),
    )
    write_bytes(path, header.encode() + points.tobytes())


def write_csv(path: Path, rows: Rows) -> None:
    """Comma-separated values under a line of names; numbers as short as they come back the same."""
    import pyarrow as pa
    from pyarrow import csv

    names = rows.dtype.names or ()
    table = pa.table({name: np.ascontiguousarray(rows[name]) for name in names})
    with written_whole(path) as temporary:
        csv.write_csv(table, temporary, csv.WriteOptions(quoting_style="none"))
