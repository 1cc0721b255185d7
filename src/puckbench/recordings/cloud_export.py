"""Export of clouds with all their attributes to the formats of other tools."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.clouds import read_cloud, wide_colours, write_cloud
from cloud_files.content import plain_suffix
from cloud_files.las import write_las
from cloud_files.las_rewriting import rewrite_las
from cloud_files.pcd import write_pcd
from cloud_files.point_columns import WIDE_COLOURS
from cloud_files.text import write_csv
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.geometry.attributes import reflectance_field
from puckbench.recordings.decoded_clouds import LASERS, TIMES
from puckbench.recordings.export import (
    OF_POINTS,
    Columns,
    checked_suffix,
    column_us,
    columns_of_returns,
    export_points,
    las_columns,
    warn,
)

_LAS = (".las", ".laz")
_COLOURS = ("red", "green", "blue")


def with_fields_of_returns(cloud: PointCloud) -> PointCloud:
    """Return a cloud with what its returns tell of each point as fields.

    The fields are ``ring``, ``time`` and ``intensity`` of `columns_of_returns`; a field that the
    cloud has already remains.
    """
    if cloud.returns is None:
        return cloud
    columns = columns_of_returns(cloud.returns, column_us(cloud.returns))
    fields = {name: part for name, part in columns.items() if name not in "xyz"}
    return replace(cloud, fields={**fields, **cloud.fields})


def export_cloud(path: Path, cloud: PointCloud) -> dict[str, Any]:
    """Write a cloud with its attributes to a file in the format that its suffix names.

    LAS and LAZ take attributes that they have no place for as extra bytes. KITTI's format (.bin)
    takes only intensities, which is told.

    Parameters
    ----------
    path
        File to write, with one of the suffixes `OF_POINTS`.
    cloud
        The cloud. Its fields may hold intensities, rings and times under any of the usual names.

    Returns
    -------
    dict
        Number of points (``points``).

    Raises
    ------
    InputError
        The suffix is another one, or the format cannot hold the coordinates.
    """
    suffix = checked_suffix(path, len(cloud))
    if suffix not in OF_POINTS:
        raise InputError(f"{path}: a cloud lacks the columns of a scan")
    if suffix == ".ply":
        write_cloud(path, cloud, describe=False)
    elif suffix == ".pcd":
        write_pcd(path, _pcd_columns(cloud))
    elif suffix == ".csv":
        write_csv(path, {**_axes(cloud), **_colours(cloud), **_attributes(cloud, "n")})
    elif suffix == ".bin":
        _write_bin(path, cloud)
    else:
        _write_las(path, cloud)
    return {"points": len(cloud)}


def export_file(path: Path, source: Path) -> dict[str, Any]:
    """Write the cloud of a file to a file in another format.

    A LAS or LAZ file that is written as LAS or LAZ keeps its header, records and attributes.

    Parameters
    ----------
    path
        File to write, with one of the suffixes `OF_POINTS`.
    source
        File of a cloud.

    Returns
    -------
    dict
        Number of points (``points``).

    Raises
    ------
    InputError
        As `export_cloud`, and if the source cannot be read.
    """
    is_las = {path.suffix.lower(), plain_suffix(source)} <= {*_LAS}
    cloud = read_cloud(source, keep_missing=is_las)
    if not is_las:
        return export_cloud(path, _with_colours_of(cloud, source))
    rewrite_las(path, source, cloud.xyz, np.arange(len(cloud)))
    return {"points": len(cloud)}


def _with_colours_of(cloud: PointCloud, source: Path) -> PointCloud:
    """Return a cloud with the colours of 16 bits of its file, if it has such colours."""
    wide: Any = None if cloud.colours is None else wide_colours(source)
    if wide is None or len(wide) != len(cloud):
        return cloud
    fields = {name: part for name, part in cloud.fields.items() if name not in WIDE_COLOURS}
    return replace(cloud, colours=wide, fields=fields)


def _axes(cloud: PointCloud) -> Columns:
    return dict(zip("xyz", cloud.xyz.T, strict=True))


def _colours(cloud: PointCloud) -> Columns:
    return {} if cloud.colours is None else dict(zip(_COLOURS, cloud.colours.T, strict=True))


def _attributes(cloud: PointCloud, normal: str) -> Columns:
    """Return normals, whose names begin with `normal`, labels and fields of a cloud as columns."""
    columns: Columns = {}
    if cloud.normals is not None:
        normals = cloud.normals.T.astype(np.float32)
        columns = dict(zip([f"{normal}{axis}" for axis in "xyz"], normals, strict=True))
    if cloud.labels is not None:
        columns["label"] = cloud.labels
    fields = cloud.fields.items()
    whole = {name: part.astype(np.uint8) for name, part in fields if part.dtype.kind == "b"}
    return {**columns, **cloud.fields, **whole}


def _pcd_columns(cloud: PointCloud) -> Columns:
    colours = _colours(cloud)
    if cloud.colours is not None and cloud.colours.dtype == np.uint8:
        colours = {"rgb": _packed(cloud.colours)}
    return {**_axes(cloud), **colours, **_attributes(cloud, "normal_")}


def _packed(colours: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return colours (n, 3) as PCL packs them: 24 bits of a float32."""
    red, green, blue = colours.astype(np.uint32).T
    return np.asarray((red << 16 | green << 8 | blue).view(np.float32))


def _write_bin(path: Path, cloud: PointCloud) -> None:
    field = reflectance_field(cloud)
    intensity = {"intensity": cloud.fields[field]} if field else {}
    names = [*_colours(cloud), *_attributes(cloud, "n")]
    if unused := [name for name in names if name != field]:
        warn(path, f"without {', '.join(unused)}, for which the format has no place")
    export_points(path, {**_axes(cloud), **intensity})


def _write_las(path: Path, cloud: PointCloud) -> None:
    others = _attributes(cloud, "n")
    names = {
        "intensity": reflectance_field(cloud),
        "ring": _first(LASERS[::-1], others),
        "time": _first(TIMES, others),
    }
    if names["ring"] and not _is_byte(others[names["ring"]]):
        names["ring"] = None
    of_returns = {name: others.pop(field) for name, field in names.items() if field}
    las = las_columns(path, {**_axes(cloud), **of_returns}, warn)
    write_las(path, {**las, **_colours(cloud)}, others)


def _first(names: Iterable[str], columns: Columns) -> str | None:
    return next((name for name in names if name in columns), None)


def _is_byte(values: NDArray[Any]) -> bool:
    return bool(((values >= 0) & (values <= 0xFF) & (values == np.floor(values))).all())
