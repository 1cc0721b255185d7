"""Point clouds and their file format: binary PLY with double coordinates and a JSON beside it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.errors import InputError
from puckbench.files import read_json, unreadable, write_json, written_whole

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PointCloud:
    """Points with optional attributes, and what is known about them.

    xyz: (n, 3) float64. normals: (n, 3) float64 unit vectors or None. colours: (n, 3) uint8 or
    None. labels: (n,) int32 or None. about: what stands in the JSON beside the file (source,
    seed, scale and offset to metres, ...).
    """

    xyz: Floats
    normals: Floats | None = None
    colours: NDArray[np.uint8] | None = None
    labels: NDArray[np.int32] | None = None
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.xyz)

    def select(self, rows: NDArray[Any]) -> PointCloud:
        """The cloud of the given rows (mask or indices), attributes taken along."""
        return replace(
            self,
            xyz=self.xyz[rows],
            normals=None if self.normals is None else self.normals[rows],
            colours=None if self.colours is None else self.colours[rows],
            labels=None if self.labels is None else self.labels[rows],
        )

    def to_metres(self, points: Floats) -> Floats:
        """Bring points (m, 3) of this cloud's frame to metres: ``points / scale + offset``."""
        scale, offset = self.about.get("scale", 1.0), self.about.get("offset", (0.0, 0.0, 0.0))
        return np.asarray(points / scale + np.asarray(offset))


def check_points(points: Floats, what: str) -> None:
    """InputError unless `points` is a non-empty, finite (n, 3) array; `what` names its source."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{what}: expected points of shape (n, 3), got {points.shape}")
    if len(points) == 0:
        raise InputError(f"{what}: the cloud is empty")
    if not np.isfinite(points).all():
        bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
        raise InputError(f"{what}: {bad} of {len(points)} points are not finite")


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
    from plyfile import PlyData, PlyElement

    columns = {name: getattr(cloud, name) for name in _FIELDS if getattr(cloud, name) is not None}
    names = [(axis, _FIELDS[name][1]) for name in columns for axis in _FIELDS[name][0]]
    rows = np.empty(len(cloud), dtype=names)
    for name, values in columns.items():
        for axis, column in zip(_FIELDS[name][0], np.atleast_2d(values.T), strict=True):
            rows[axis] = column
    with written_whole(path) as temporary:
        PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(temporary))
        if describe:
            write_json(sidecar(path), {**cloud.about, "points": len(cloud)})


def read_cloud(path: str | Path) -> PointCloud:
    """Read the vertices of any PLY file, and the JSON beside it where there is one.

    Raises InputError when the file is missing, damaged, empty or has points that are not finite.
    """
    path = Path(path)
    vertices = _read_vertices(path)
    names = set(vertices.dtype.names or ())
    values: dict[str, Any] = {}
    for name, (axes, kind) in _FIELDS.items():
        if names.issuperset(axes):
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


def _read_vertices(path: Path) -> NDArray[Any]:
    from plyfile import PlyData, PlyParseError

    try:
        data = PlyData.read(str(path), known_list_len={"face": {"vertex_indices": 3}})
        return np.asarray(data["vertex"].data)
    except OSError as error:
        raise unreadable(path, error) from error
    except (PlyParseError, KeyError, ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a readable PLY file ({error})") from error
