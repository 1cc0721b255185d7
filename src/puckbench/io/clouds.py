"""Files of point clouds: written as binary PLY with double coordinates and a JSON beside it.

Read are all formats of `SUFFIXES`, by their suffix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from puckbench.core.errors import InputError, naming
from puckbench.core.files import read_json, write_json, written_whole
from puckbench.geometry.cloud import PointCloud, check_points
from puckbench.io.archives import read_archive
from puckbench.io.cloud_arrays import read_frame, read_npy
from puckbench.io.cloud_text import read_text
from puckbench.io.e57 import read_e57
from puckbench.io.las import read_las_points
from puckbench.io.pcd import is_gap, read_pcd
from puckbench.io.ply import has_faces, read_ply, write_vertices
from puckbench.io.point_columns import Columns, cloud_of, storable


def sidecar(path: Path) -> Path:
    """The JSON file that describes the artefact at `path`."""
    return path.with_suffix(".json")


_COLUMNS = {
    "xyz": (("x", "y", "z"), "<f8"),
    "normals": (("nx", "ny", "nz"), "<f4"),
    "colours": (("red", "green", "blue"), "u1"),
    "labels": (("label",), "<i4"),
}


def cloud_bytes(cloud: PointCloud) -> bytes:
    """The bytes of a cloud's PLY file, without its description."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "cloud.ply")
        write_cloud(path, cloud, describe=False)
        return path.read_bytes()


def read_archived_cloud(archive: Path, name: str) -> PointCloud:
    """Read a cloud that is a member of an archive; InputError as of `read_cloud`."""
    members = read_archive(archive)
    if name not in members:
        raise InputError(f"{archive}: has no member {name}")
    with TemporaryDirectory() as folder, naming(archive):
        path = Path(folder, name)
        path.write_bytes(members[name])
        return read_cloud(path)


def write_cloud(path: Path, cloud: PointCloud, describe: bool = True) -> None:
    """Write a binary little-endian PLY (double coordinates, float normals, fields) and its JSON.

    Both appear when both are written, the JSON first, so that a PLY that exists is complete.
    InputError for a name that another format is known by.
    """
    if path.suffix.lower() in _FOREIGN:
        raise InputError(f"{path}: a PLY file is written: name it so (export writes others)")
    columns = {
        axis: column.astype(kind)
        for name, (axes, kind) in _COLUMNS.items()
        if (values := getattr(cloud, name)) is not None
        for axis, column in zip(axes, np.atleast_2d(values.T), strict=True)
    }
    with written_whole(path) as temporary:
        write_vertices(temporary, {**columns, **storable(cloud.fields)})
        if describe:
            write_json(sidecar(path), {**cloud.about, "points": len(cloud)})


def read_cloud(path: str | Path) -> PointCloud:
    """Read a point cloud of any format in `SUFFIXES`; of a PLY file also the JSON beside it.

    Raises InputError when the file is missing, damaged, empty, a mesh, of another format, or has
    points that are not finite.
    """
    cloud = read_points(Path(path))
    check_points(cloud.xyz, str(path))
    return cloud


def read_points(path: Path) -> PointCloud:
    """As `read_cloud`, of a cloud that may be empty or have points that are not finite."""
    suffix = path.suffix.lower()
    if suffix not in _READERS and path.exists() and not _begins_as_ply(path):
        raise InputError(f"{path}: not a point cloud by its name ({', '.join(SUFFIXES)})")
    columns = _READERS.get(suffix, _read_ply_points)(path)
    with naming(path):
        cloud = cloud_of(columns)
    about = {}
    if (beside := sidecar(path)).exists() and suffix not in _FOREIGN:
        about = read_json(beside)
    return replace(cloud, about=about if isinstance(about, dict) else {})


def _begins_as_ply(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(3) == b"ply"


def _read_ply_points(path: Path) -> Columns:
    if has_faces(path):
        raise InputError(f"{path}: a mesh, not a cloud: sample or scan it first")
    return read_ply(path)


def _read_pcd_points(path: Path) -> Columns:
    return {name: part for name, part in read_pcd(path).items() if not is_gap(name)}


_FOREIGN: dict[str, Callable[[Path], Columns]] = {
    ".pcd": _read_pcd_points,
    ".las": read_las_points,
    ".laz": read_las_points,
    ".e57": read_e57,
    **dict.fromkeys((".xyz", ".txt", ".csv", ".asc", ".pts"), read_text),
    ".npy": read_npy,
    ".npz": read_npy,
    ".bin": read_frame,
}
_READERS = {".ply": _read_ply_points, **_FOREIGN}
SUFFIXES = (*_READERS,)
"""Of the formats that are read."""
