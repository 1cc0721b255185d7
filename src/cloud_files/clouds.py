"""Reading of point clouds in all supported formats, and writing of clouds as binary PLY files."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

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
    """Return a cloud as the bytes of a binary PLY file, the same as `write_cloud` writes."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "cloud.ply")
        write_cloud(path, cloud, describe=False)
        return path.read_bytes()


def write_cloud(path: str | Path, cloud: PointCloud, describe: bool = True) -> None:
    """Write a cloud as a binary PLY file, and its description beside the PLY file.

    Both files appear only when both are complete.

    Parameters
    ----------
    path
        The PLY file. The description has the same name, but ends in ``.json``.
    cloud
        Coordinates are written as float64, normals as float32, colours as bytes (or as 16 bits if
        the cloud has these), labels as int32, and each field in the smallest type of PLY that holds
        it without loss.
    describe
        Whether to write the description: `cloud.about`, and the number of points.

    Raises
    ------
    InputError
        The suffix of `path` is that of another format, or a file cannot be written.
    """
    path = Path(path)
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
    """Read a point cloud from a file of any format whose suffix is in `SUFFIXES`.

    Missing returns, which some sensors and programs store as points at the origin or without
    coordinates, are left out (`cloud_files.missing_returns` says how they are recognised).

    Parameters
    ----------
    path
        The file, which may be compressed: its suffix is then followed by ``.gz``, ``.bz2``,
        ``.xz`` or ``.zst``.
    keep_missing
        Whether to keep missing returns as points.
    drop_invalid
        Whether to leave out points with a coordinate that is infinite or not a number. By default,
        such points raise InputError.
    bin_columns
        For a ``.bin`` file only: the number of values per point, or their names separated by
        commas (see `cloud_files.float32_frames.read_float32_frame`). By default, they are
        estimated.

    Returns
    -------
    PointCloud
        Coordinates (n, 3) as float64: in metres for the formats in `IN_METRES`, and in the unit of
        the file for others. Normals, colours of 8 bits and integer labels are recognised by the
        names of their columns; all other numeric columns are fields. ``about`` is the description
        that `write_cloud` wrote beside a PLY file, or has the numbers of points that were left
        out: ``dropped_points`` (all of them) and ``missing_returns``.

    Raises
    ------
    InputError
        The file is missing, damaged, empty or a mesh, or points are not finite. The message is one
        line that begins with the file's name.
    """
    path = Path(path)
    cloud = read_unchecked_cloud(path, keep_missing, drop_invalid, bin_columns)
    return checked_cloud(cloud, path)


def checked_cloud(cloud: UncheckedCloud, path: Path) -> PointCloud:
    """Return the cloud after a check that it has points and that all coordinates are finite.

    Parameters
    ----------
    cloud
        The cloud to check.
    path
        The file that the message of the error names.

    Raises
    ------
    InputError
        The cloud is empty, or a coordinate is infinite or not a number.
    """
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
    """Read a cloud as `read_cloud` does, but accept a cloud that is empty or not finite.

    Parameters
    ----------
    path, keep_missing, drop_invalid, bin_columns
        As in `read_cloud`.
    convert
        Whether to convert coordinates of LAS files to metres from the unit of their coordinate
        reference system.

    Returns
    -------
    UncheckedCloud
        The cloud as the file holds it; `checked_cloud` checks it.
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
    """Return a cloud without missing returns: points that stand for firings without a return.

    The number of removed points is logged as a warning and added to ``about`` as
    ``missing_returns``.

    Parameters
    ----------
    cloud
        The cloud.
    missing
        Mask (n,) of the missing returns.
    path
        The file that messages name.

    Raises
    ------
    InputError
        All points are missing returns.
    """
    if len(cloud) and missing.all():
        raise InputError(f"{path}: all of its {len(cloud)} points are missing returns")
    reason = "are missing returns (--keep-missing keeps them)"
    present = _without(cloud, missing, path, reason)
    count = len(cloud) - len(present)
    return replace(present, about={**present.about, "missing_returns": count}) if count else present


def without_invalid(cloud: UncheckedCloud, path: Path) -> UncheckedCloud:
    """Return a cloud without points that have a coordinate that is infinite or not a number.

    The number of removed points is logged as a warning that names `path`, and added to ``about`` as
    ``dropped_points``.
    """
    invalid = np.asarray(~np.isfinite(cloud.xyz).all(axis=1))
    return _without(cloud, invalid, path, "are not finite")


def removal_counts(about: Mapping[str, Any]) -> dict[str, int]:
    """Return the entries of a cloud's description that say how many points its reader left out."""
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
    """Read the colours of a cloud file, if they need more than 8 bits.

    Returns
    -------
    array or None
        Colours (n, 3) of all points in the order of the file; None if the file has no colours or
        all colours fit in 8 bits.
    """
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
