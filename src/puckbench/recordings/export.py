"""Export of scans and recordings to the formats of other tools, chosen by the file's suffix."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.evd import write_evd
from cloud_files.float32_frames import write_float32_frame
from cloud_files.las import write_las
from cloud_files.pcd import write_pcd
from cloud_files.ply import write_ply
from cloud_files.text import write_csv
from pointkit.column_tables import is_table_of
from pointkit.errors import InputError
from pointkit.lidar.return_table import UNKNOWN, ReturnTable, read_return_table, return_table_of
from pointkit.lidar.returns import Returns
from puckbench.recordings.writing import write_pcap
from virtual_lidar.scan_table import ScanTable, read_scan

Source = ScanTable | ReturnTable | Returns
Columns = dict[str, NDArray[Any]]

_KITTI_BRIGHTEST = 255
"""Reflectivity that KITTI's files store as intensity 1."""
_LAS_BRIGHTEST = 0xFFFF
"""Largest intensity that LAS files store."""
_log = logging.getLogger(__name__)


def _pcd_columns(columns: Columns) -> Columns:
    if "laser_id" in columns:
        label = columns["laser_id"].astype(np.uint32)
        return {**_of(columns, *"xyz"), "label": label, **_of(columns, "timestamp")}
    # The point type XYZIRT of ROS drivers.
    order = [name for name in ("x", "y", "z", "intensity", "ring", "time") if name in columns]
    single = {"time": columns["time"].astype(np.float32)} if "time" in columns else {}
    return {**_of(columns, *order), **single}


def _las_columns(path: Path, columns: Columns) -> Columns:
    values = _intensities(columns)
    if _is_beyond(values, _LAS_BRIGHTEST) or (values != np.floor(values)).any():
        told = f"become whole numbers from 0 to {_LAS_BRIGHTEST}"
        _log.warning("%s: intensities from %g to %g %s", path, values.min(), values.max(), told)
    if "laser_id" in columns:
        return columns
    names = {"laser_id": "ring", "reflectivity": "intensity", "timestamp": "time"}
    others = {name: columns[other] for name, other in names.items() if other in columns}
    return {**_of(columns, *"xyz"), **others}


def _kitti_columns(path: Path, columns: Columns) -> Columns:
    values = _intensities(columns)
    most = _KITTI_BRIGHTEST if values.max(initial=0) > 1 else 1
    if _is_beyond(values, most):
        told = f"remain as they are, as they are none from 0 to {most}"
        _log.warning("%s: intensities from %g to %g %s", path, values.min(), values.max(), told)
        most = 1
    return {**_of(columns, *"xyz"), "intensity": values / most}


def _intensities(columns: Columns) -> NDArray[Any]:
    unknown = np.zeros(len(columns["x"]))
    if "reflectivity" in columns:
        return np.where(columns["reflectivity"] == UNKNOWN, 0, columns["reflectivity"])
    return columns.get("intensity", unknown)


def _is_beyond(values: NDArray[Any], most: int) -> bool:
    return not bool(((values >= 0) & (values <= most)).all())


def _of(columns: Columns, *names: str) -> Columns:
    return {name: columns[name] for name in names}


# These formats take any columns of points; the others take virtual scans only.
_POINTS: dict[str, Callable[[Path, Columns], None]] = {
    ".ply": write_ply,
    ".pcd": lambda path, columns: write_pcd(path, _pcd_columns(columns)),
    ".csv": write_csv,
    ".las": lambda path, columns: write_las(path, _las_columns(path, columns)),
    ".laz": lambda path, columns: write_las(path, _las_columns(path, columns)),
    ".bin": lambda path, columns: write_float32_frame(path, _kitti_columns(path, columns)),
}
FORMATS = (*_POINTS, ".evd", ".pcap")
"""Suffixes of the files that `export` writes."""

_OF_SCANS = (
    *("timestamp", "frame", "laser_id", "yaw", "pitch", "incidence", "object_id", "primitive_id"),
    *("nx", "ny", "nz"),
)
_OF_RECORDINGS = (
    *("x", "y", "z", "timestamp", "turn", "laser_id", "return_kind", "azimuth", "elevation"),
    *("distance", "reflectivity"),
)


def read_source(path: Path) -> ScanTable | ReturnTable:
    """Read the Parquet file of a virtual scan or of a recording's returns."""
    return read_return_table(path) if is_table_of(path, ReturnTable) else read_scan(path)


def export(path: Path, source: Source, clean: bool = False) -> dict[str, Any]:
    """Write a scan or a recording to a file in the format that its suffix names.

    Parameters
    ----------
    path
        File to write, with one of the suffixes `FORMATS`.
    source
        A virtual scan, or the returns of a recording. A recording cannot be written in formats that
        contain true values (.evd, .pcap).
    clean
        Whether to write a scan's true coordinates and distances instead of the measured ones.
        BlenSor's format (.evd) contains both.

    Returns
    -------
    dict
        Number of points (``points``); for packet captures, also of ``packets`` and ``returns``.

    Raises
    ------
    InputError
        The suffix is unknown, there is no return, or the format does not suit the source.
    """
    suffix = _checked_suffix(path, len(source))
    if isinstance(source, ReturnTable | Returns):
        if clean:
            raise InputError(f"{path}: a recording has no true coordinates")
        return export_points(path, _recorded_columns(source))
    if suffix in _POINTS:
        return export_points(path, _scan_columns(source, clean))
    if suffix == ".evd":
        write_evd(path, source)
        return {"points": len(source)}
    return {"points": len(source), **write_pcap(path, source, noisy=not clean)}


def export_points(path: Path, columns: Columns) -> dict[str, Any]:
    """Write points to a file in the format that its suffix names.

    Parameters
    ----------
    path
        File to write, with the suffix .ply, .pcd, .csv, .las, .laz or .bin.
    columns
        Values, (n,), by name of the column: ``x``, ``y``, ``z`` and any others.

    Returns
    -------
    dict
        Number of points (``points``).

    Raises
    ------
    InputError
        The suffix is another one, or there are no points.
    """
    suffix = _checked_suffix(path, len(columns["x"]))
    if suffix not in _POINTS:
        raise InputError(f"{path}: a recording has no true coordinates and no scan's columns")
    _POINTS[suffix](path, columns)
    return {"points": len(columns["x"])}


def _checked_suffix(path: Path, points: int) -> str:
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: unknown suffix {suffix!r} (known: {', '.join(FORMATS)})")
    if points == 0:
        raise InputError(f"{path}: there is no return to export")
    return suffix


def _recorded_columns(source: ReturnTable | Returns) -> Columns:
    if isinstance(source, ReturnTable):
        return _of(source.columns, *_OF_RECORDINGS)
    table = return_table_of(source, _column_us(source))
    columns = {**_of(table.columns, *"xyz"), "ring": _rings(source)[table["laser_id"]]}
    if all(turn.reflectivities is not None for turn in source.turns):
        columns["intensity"] = table["reflectivity"].astype(np.float32)
    if all(turn.times is not None for turn in source.turns):
        columns["time"] = table["timestamp"]
    return columns


def _rings(returns: Returns) -> NDArray[np.uint16]:
    return np.argsort(returns.layout.order).astype(np.uint16)


def _column_us(returns: Returns) -> float:
    times = [turn.times for turn in returns.turns if turn.times is not None]
    steps = np.concatenate([np.diff(part.astype(np.float64)) for part in times] or [np.zeros(0)])
    steps = steps[steps > 0]  # the clock restarts hourly
    columns = returns.layout.columns_per_block * returns.layout.blocks_per_time
    return float(np.median(steps)) / columns if len(steps) else 0.0


def _scan_columns(table: ScanTable, clean: bool) -> Columns:
    suffix = "" if clean else "_noisy"
    measured = {name: table[name + suffix] for name in ("x", "y", "z", "distance")}
    optional = {"reflectivity"} & set(table.columns)
    return {**measured, **{name: table[name] for name in (*_OF_SCANS, *optional)}}
