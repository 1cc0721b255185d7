"""Readers of point clouds in all formats in `SUFFIXES`, and a writer of binary PLY."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cloud_files.archives import read_archive
from cloud_files.content import COMPRESSED, plain_suffix, read_content, unpacked
from cloud_files.descriptions import read_description, sidecar, write_description
from cloud_files.missing_returns import missing_firings, missing_returns
from cloud_files.ply import has_faces, read_ply, write_vertices
from cloud_files.point_columns import cloud_from_columns, coarse_step, colours_of, ply_columns
from pointkit.errors import InputError, naming
from pointkit.files import written_whole
from pointkit.geometry.cloud import PointCloud, UncheckedCloud, check_points
from pointkit.isolated import Columns
from pointkit.lazy import imported

__all__ = ["IN_METRES", "SUFFIXES", "read_cloud", "read_unchecked_cloud", "sidecar", "write_cloud"]

IN_METRES = (".las", ".laz", ".e57", ".bin")
"""Suffixes of formats with coordinates in metres; other formats define no unit."""
_HEAD_BYTES = 1 << 10
_log = logging.getLogger(__name__)
_PLY_COLUMNS = {
    "xyz": (("x", "y", "z"), "<f8"),
    "normals": (("nx", "ny", "nz"), "<f4"),
    "colours": (("red", "green", "blue"), "u1"),
    "labels": (("label",), "<i4"),
}


def cloud_bytes(cloud: PointCloud) -> bytes:
    """Return a cloud as the bytes of a PLY file, without the description `about`."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "cloud.ply")
        write_cloud(path, cloud, describe=False)
        return path.read_bytes()


def read_archived_cloud(archive: Path, name: str) -> PointCloud:
    members = read_archive(archive)
    if name not in members:
        raise InputError(f"{archive}: has no member {name}")
    with TemporaryDirectory() as folder, naming(archive):
        path = Path(folder, name)
        path.write_bytes(members[name])
        return read_cloud(path)


def write_cloud(path: Path, cloud: PointCloud, describe: bool = True) -> None:
    """Write a cloud as a binary PLY file (float64), and the cloud's description as JSON beside it.

    Both files appear only when both are complete.
    """
    if path.suffix.lower() in (*SUFFIXES[1:], *COMPRESSED):
        raise InputError(f"{path}: only PLY files are written; name it .ply")
    columns = {
        axis: column.astype("<u2" if column.dtype == np.uint16 else kind)
        for name, (axes, kind) in _PLY_COLUMNS.items()
        if (values := getattr(cloud, name)) is not None
        for axis, column in zip(axes, np.atleast_2d(values.T), strict=True)
    }
    with written_whole(path) as temporary:
        write_vertices(temporary, {**columns, **ply_columns(cloud.fields)})
        if describe:
            write_description(path, "cloud", {**cloud.about, "points": len(cloud)})


def read_cloud(
    path: str | Path,
    *,
    keep_missing: bool = False,
    drop_invalid: bool = False,
    bin_columns: str | None = None,
) -> PointCloud:
    """Read a point cloud in any format in `SUFFIXES`, and the description (JSON) beside a PLY file.

    Missing returns (`pointkit.geometry.missing_returns`) are removed and counted in the
    description.

    Parameters
    ----------
    path
        Names of compressed files end in .gz, .bz2, .xz or .zst.
    keep_missing
        Whether to keep missing returns as points.
    drop_invalid
        Whether to remove points that are not finite; by default, such points raise InputError.
    bin_columns
        Columns of a .bin file, see `cloud_files.float32_frames.read_float32_frame`.

    Raises
    ------
    InputError
        The file is missing, damaged, empty or a mesh, or points are not finite.
    """
    cloud = read_unchecked_cloud(Path(path), keep_missing, drop_invalid, bin_columns)
    return checked_cloud(cloud, Path(path))


def checked_cloud(cloud: UncheckedCloud, path: Path) -> PointCloud:
    try:
        check_points(cloud.xyz, str(path))
    except InputError as error:
        if np.isfinite(cloud.xyz).all():
            raise
        raise InputError(f"{error} (prepare and run leave them out: --drop-invalid)") from error
    return cloud.checked()


def read_unchecked_cloud(
    path: Path,
    keep_missing: bool = False,
    drop_invalid: bool = False,
    bin_columns: str | None = None,
    convert: bool = True,
) -> UncheckedCloud:
    """Read a cloud like `read_cloud`, but allow empty clouds and points that are not finite.

    With `convert`, LAS coordinates are converted to metres.
    """
    columns = _read_columns(path, bin_columns, convert, keep_missing)
    with naming(path):
        cloud = cloud_from_columns(columns)
    if step := coarse_step(columns):
        _log.warning("%s: coordinates in single precision, in steps of %.2g", path, step)
    is_other = plain_suffix(path) in SUFFIXES[1:]
    about = None if is_other else read_description(path, {"points": len(cloud)})
    if about is not None:
        with naming(sidecar(path)):
            cloud = replace(cloud, about=about)
    elif not keep_missing:
        missing = _missing(cloud, path)
        if drop_invalid or np.isfinite(cloud.xyz[~missing]).all():  # other clouds are refused
            cloud = without_missing(cloud, missing, path)
    return without_invalid(cloud, path) if drop_invalid else cloud


def without_missing(
    cloud: UncheckedCloud, missing: NDArray[np.bool_], path: Path
) -> UncheckedCloud:
    """Remove points where `missing` (n,) is true; warn, and count them in the description."""
    if len(cloud) and missing.all():
        raise InputError(f"{path}: all of its {len(cloud)} points are missing returns")
    reason = "are missing returns (--keep-missing keeps them)"
    present = _without(cloud, missing, path, reason)
    count = len(cloud) - len(present)
    return replace(present, about={**present.about, "missing_returns": count}) if count else present


def without_invalid(cloud: UncheckedCloud, path: Path) -> UncheckedCloud:
    """Remove points that are not finite, warn, and count them in the description."""
    invalid = np.asarray(~np.isfinite(cloud.xyz).all(axis=1))
    return _without(cloud, invalid, path, "are not finite")


def removal_counts(about: Mapping[str, Any]) -> dict[str, int]:
    return {name: about[name] for name in ("dropped_points", "missing_returns") if name in about}


def _without(
    cloud: UncheckedCloud, rows: NDArray[np.bool_], path: Path, reason: str
) -> UncheckedCloud:
    count = int(np.count_nonzero(rows))
    if not count:
        return cloud
    _log.warning("%s: %d of %d points %s: left out", path, count, len(cloud), reason)
    dropped = cloud.about.get("dropped_points", 0) + count
    return replace(cloud.select(~rows), about={**cloud.about, "dropped_points": dropped})


def _missing(cloud: PointCloud, path: Path) -> NDArray[np.bool_]:
    suffix = plain_suffix(path)
    organised = suffix == ".pcd" and imported("cloud_files.pcd:is_organised")(path)
    missing = missing_returns(cloud.xyz, organised)
    if suffix == ".bin" and "ring" in cloud.fields:
        missing |= missing_firings(cloud.xyz, cloud.fields["ring"])
    return missing


def _read_columns(
    path: Path, bin_columns: str | None, convert: bool, keep_missing: bool
) -> Columns:
    suffix = plain_suffix(path)
    if path.exists():
        _check_kind(path, suffix)
    read: Any = imported(READERS[suffix]) if suffix in READERS else _read_ply_points
    if suffix in (".las", ".laz", ".e57"):
        with unpacked(path) as plain:
            more = (keep_missing,) if suffix == ".e57" else (convert,)
            return cast(Columns, read(plain, *more))
    return cast(Columns, read(path, bin_columns) if suffix == ".bin" else read(path))


def wide_colours(path: Path) -> NDArray[np.uint16] | None:
    """Return a cloud file's colours (n, 3) as they are if some exceed 8 bits, else None."""
    colours = colours_of(_read_columns(path, None, convert=False, keep_missing=True))
    if colours is None or colours.dtype.kind not in "iu":
        return None
    is_wide = 0xFF < colours.max(initial=0) <= 0xFFFF and colours.min(initial=0) >= 0
    return colours.astype(np.uint16) if is_wide else None


def _check_kind(path: Path, suffix: str) -> None:
    head = b"" if path.is_dir() else read_content(path, _HEAD_BYTES)
    if head.lstrip().lower().startswith((b"<!doctype html", b"<html")):
        raise InputError(f"{path}: an HTML page, not the file: download it again")
    if suffix not in SUFFIXES and not head.startswith(b"ply"):
        raise InputError(f"{path}: not a point cloud by its name ({', '.join(SUFFIXES)})")


def _read_ply_points(path: Path) -> Columns:
    if has_faces(path):
        raise InputError(f"{path}: a mesh, not a cloud: sample or scan it first")
    return read_ply(path)


_TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
READERS = {
    ".pcd": "cloud_files.pcd:read_pcd",
    **dict.fromkeys((".las", ".laz"), "cloud_files.las:read_las_points"),
    ".e57": "cloud_files.e57:read_e57",
    **dict.fromkeys(_TEXT_SUFFIXES, "cloud_files.text:read_text"),
    **dict.fromkeys((".npy", ".npz"), "cloud_files.npy:read_npy"),
    ".bin": "cloud_files.float32_frames:read_float32_frame",
}
"""Readers of formats other than PLY, by suffix."""
SUFFIXES = (".ply", *READERS)
"""Suffixes of readable files, PLY first; compressed files have a second suffix."""
