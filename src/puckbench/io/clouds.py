"""Files of point clouds: binary PLY with double coordinates and a JSON beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_json, write_json, written_whole
from puckbench.geometry.cloud import PointCloud, check_points
from puckbench.io.ply import has_faces, read_ply, write_vertices


def sidecar(path: Path) -> Path:
    """The JSON file that describes the artefact at `path`."""
    return path.with_suffix(".json")


_FIELDS = {
    "xyz": (("x", "y", "z"), "<f8"),
    "normals": (("nx", "ny", "nz"), "<f4"),
    "colours": (("red", "green", "blue"), "u1"),
    "labels": (("label",), "<i4"),
}


def write_cloud(path: Path, cloud: PointCloud, describe: bool = True) -> None:
    """Write a binary little-endian PLY (double coordinates, float normals) and its JSON.

    Both appear when both are written, the JSON first, so that a PLY that exists is complete.
    """
    columns = {
        axis: column.astype(kind)
        for name, (axes, kind) in _FIELDS.items()
        if (values := getattr(cloud, name)) is not None
        for axis, column in zip(axes, np.atleast_2d(values.T), strict=True)
    }
    with written_whole(path) as temporary:
        write_vertices(temporary, columns)
        if describe:
            write_json(sidecar(path), {**cloud.about, "points": len(cloud)})


def read_cloud(path: str | Path) -> PointCloud:
    """Read the points of any PLY file, and the JSON beside it where there is one.

    Raises InputError when the file is missing, damaged, empty, a mesh, or has points that are not
    finite.
    """
    path = Path(path)
    if has_faces(path):
        raise InputError(f"{path}: a mesh, not a cloud: sample or scan it first")
    vertices = read_ply(path)
    values: dict[str, Any] = {}
    for name, (axes, kind) in _FIELDS.items():
        if vertices.keys() >= set(axes):
            stacked = np.column_stack([vertices[axis] for axis in axes])
            values[name] = np.ascontiguousarray(stacked, dtype=np.dtype(kind).newbyteorder("="))
    if "xyz" not in values:
        raise InputError(f"{path}: the vertices have no x, y, z")
    if "labels" in values:
        values["labels"] = values["labels"][:, 0]
    if "normals" in values:
        values["normals"] = values["normals"].astype(np.float64)
    check_points(values["xyz"], str(path))
    about = read_json(sidecar(path)) if sidecar(path).exists() else {}
    return PointCloud(**values, about=about)
