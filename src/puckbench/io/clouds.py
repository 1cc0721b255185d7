"""Files of point clouds: written as binary PLY with double coordinates and a JSON beside it.

Read are all formats of `SUFFIXES`, by their suffix.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.content import plain_suffix, read_content, unpacked
from puckbench.core.errors import InputError, naming
from puckbench.core.files import written_whole
from puckbench.geometry.cloud import PointCloud, check_points
from puckbench.geometry.missing_returns import missing_firings, missing_returns
from puckbench.io.archives import read_archive
from puckbench.io.cloud_arrays import read_npy
from puckbench.io.cloud_text import read_text
from puckbench.io.descriptions import read_description, sidecar, write_description
from puckbench.io.e57 import read_e57
from puckbench.io.frames import read_frame
from puckbench.io.las import read_las_points
from puckbench.io.pcd import is_gap, is_organised, read_pcd
from puckbench.io.ply import has_faces, read_ply, write_vertices
from puckbench.io.point_columns import Columns, cloud_of, coarse_step, storable

__all__ = ["SUFFIXES", "read_cloud", "read_points", "sidecar", "write_cloud"]

_HEAD = 1 << 10
_log = logging.getLogger(__name__)
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
            write_description(path, "cloud", {**cloud.about, "points": len(cloud)})


def read_cloud(
    path: str | Path,
    *,
    keep_missing: bool = False,
    drop_invalid: bool = False,
    bin_columns: str | None = None,
) -> PointCloud:
    """Read a point cloud of any format in `SUFFIXES`; of a PLY file also the JSON beside it.

    Missing returns of a sensor (`puckbench.geometry.missing_returns`) are left out and counted in
    the description: ``missing_returns``, and ``dropped_points`` with all others.

    Parameters
    ----------
    path
        The file; compressed ones end in .gz, .bz2, .xz or .zst.
    keep_missing
        Keep missing returns as points.
    drop_invalid
        Leave out points that are not finite.
    bin_columns
        Columns of a frame (.bin), as `puckbench.io.frames.read_frame` takes them.

    Raises
    ------
    InputError
        The file is missing, damaged, empty, a mesh, of another format, or has points that are not
        finite.
    """
    cloud = read_points(Path(path), keep_missing, drop_invalid, bin_columns)
    check_cloud(cloud, Path(path))
    return cloud


def check_cloud(cloud: PointCloud, path: Path) -> None:
    """Refuse a cloud without points, or with points that are not finite."""
    try:
        check_points(cloud.xyz, str(path))
    except InputError as error:
        if len(cloud) == len(cloud.finite()):
            raise
        raise InputError(f"{error} (prepare and run leave them out: --drop-invalid)") from error


def read_points(
    path: Path,
    keep_missing: bool = False,
    drop_invalid: bool = False,
    bin_columns: str | None = None,
    convert: bool = True,
) -> PointCloud:
    """As `read_cloud`, of a cloud that may be empty or have points that are not finite.

    With `convert`, a LAS file's coordinates become metres by its coordinate reference system.
    """
    suffix = plain_suffix(path)
    if path.exists():
        _check_kind(path, suffix)
    read = _READERS.get(suffix, _read_ply_points)
    options: dict[str, Any] = {"columns": bin_columns} if read is read_frame else {}
    if suffix in (".las", ".laz"):
        options = {"convert": convert}
    columns = read(path, **options)
    with naming(path):
        cloud = cloud_of(columns)
    if step := coarse_step(columns):
        _log.warning("%s: coordinates in single precision, in steps of %.2g", path, step)
    about = None if suffix in _FOREIGN else read_description(path, {"points": len(cloud)})
    if about is not None:
        with naming(sidecar(path)):
            cloud = replace(cloud, about=about)
    elif not keep_missing:
        missing = _missing(cloud, path)
        if drop_invalid or np.isfinite(cloud.xyz[~missing]).all():  # else it is refused as a whole
            cloud = without_missing(cloud, missing, path)
    return without_invalid(cloud, path) if drop_invalid else cloud


def without_missing(cloud: PointCloud, missing: NDArray[np.bool_], path: Path) -> PointCloud:
    """The cloud without missing returns (n,); a remark and the description count them."""
    if len(cloud) and missing.all():
        raise InputError(f"{path}: all of its {len(cloud)} points are missing returns")
    left = _without(cloud, missing, path, "are missing returns (--keep-missing keeps them)")
    count = len(cloud) - len(left)
    return replace(left, about={**left.about, "missing_returns": count}) if count else left


def without_invalid(cloud: PointCloud, path: Path) -> PointCloud:
    """The cloud without points that are not finite; a remark and the description count them."""
    invalid = np.asarray(~np.isfinite(cloud.xyz).all(axis=1))
    return _without(cloud, invalid, path, "are not finite")


def counted(about: Mapping[str, Any]) -> dict[str, int]:
    """What a description says of points that were left out."""
    return {name: about[name] for name in ("dropped_points", "missing_returns") if name in about}


def _without(cloud: PointCloud, rows: NDArray[np.bool_], path: Path, what: str) -> PointCloud:
    count = int(np.count_nonzero(rows))
    if not count:
        return cloud
    _log.warning("%s: %d of %d points %s: left out", path, count, len(cloud), what)
    dropped = cloud.about.get("dropped_points", 0) + count
    return replace(cloud.select(~rows), about={**cloud.about, "dropped_points": dropped})


def _missing(cloud: PointCloud, path: Path) -> NDArray[np.bool_]:
    """Whether each point of a file is a missing return."""
    missing = missing_returns(cloud.xyz, plain_suffix(path) == ".pcd" and is_organised(path))
    if plain_suffix(path) == ".bin" and "ring" in cloud.fields:
        missing |= missing_firings(cloud.xyz, cloud.fields["ring"])
    return missing


def _check_kind(path: Path, suffix: str) -> None:
    """InputError where a file is of another kind by its name or its first bytes."""
    head = b"" if path.is_dir() else read_content(path, _HEAD)
    if head.lstrip().lower().startswith((b"<!doctype html", b"<html")):
        raise InputError(f"{path}: a page of the web (HTML), not the file: download it again")
    if suffix not in _READERS and not head.startswith(b"ply"):
        raise InputError(f"{path}: not a point cloud by its name ({', '.join(SUFFIXES)})")


def _read_ply_points(path: Path) -> Columns:
    if has_faces(path):
        raise InputError(f"{path}: a mesh, not a cloud: sample or scan it first")
    return read_ply(path)


def _read_pcd_points(path: Path) -> Columns:
    return {name: part for name, part in read_pcd(path).items() if not is_gap(name)}


def _of_plain_files(read: Callable[[Path], Columns]) -> Callable[[Path], Columns]:
    """A reader of compressed files by one that needs a file."""

    def read_unpacked(path: Path) -> Columns:
        with unpacked(path) as plain:
            return read(plain)

    return read_unpacked


def _read_las_points(path: Path, convert: bool) -> Columns:
    with unpacked(path) as plain:
        return read_las_points(plain, convert)


_FOREIGN: dict[str, Callable[..., Columns]] = {
    ".pcd": _read_pcd_points,
    ".las": _read_las_points,
    ".laz": _read_las_points,
    ".e57": _of_plain_files(read_e57),
    **dict.fromkeys((".xyz", ".txt", ".csv", ".asc", ".pts"), read_text),
    ".npy": read_npy,
    ".npz": read_npy,
    ".bin": read_frame,
}
_READERS = {".ply": _read_ply_points, **_FOREIGN}
SUFFIXES = (*_READERS,)
"""Of the formats that are read; a compressed file has another after it."""
