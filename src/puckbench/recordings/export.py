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
from puckbench.recordings.decoded_clouds import check_finite
from puckbench.recordings.writing import write_pcap
from virtual_lidar.scan_table import ScanTable, read_scan

Source = ScanTable | ReturnTable | Returns
Columns = dict[str, NDArray[Any]]
Tell = Callable[[Path, str], None]
"""Function that warns of what a file cannot hold; its arguments are the file and the message."""

_KITTI_BRIGHTEST = 255
"""Reflectivity that KITTI's files store as intensity 1."""
_LAS_BRIGHTEST = 0xFFFF
"""Largest intensity that LAS files store."""
_log = logging.getLogger(__name__)


def warn(path: Path, text: str) -> None:
    """Log a warning that names a file."""
    _log.warning("%s: %s", path, text)


def _pcd_columns(columns: Columns) -> Columns:
    if "laser_id" in columns:
        label = columns["laser_id"].astype(np.uint32)
        return {**_of(columns, *"xyz"), "label": label, **_of(columns, "timestamp")}
    # The point type XYZIRT of ROS drivers.
    order = [name for name in ("x", "y", "z", "intensity", "ring", "time") if name in columns]
    single = {"time": columns["time"].astype(np.float32)} if "time" in columns else {}
    return {**_of(columns, *order), **single}


def las_columns(path: Path, columns: Columns, tell: Tell) -> Columns:
    """Return columns under the names that `write_las` takes.

    Intensities that are shares of 1 are multiplied by the largest of LAS, which is told.

    Parameters
    ----------
    path
        The file to write.
    columns
        Values, (n,), by name, as for `export_points`.
    tell
        Function that warns of values that the format changes.
    """
    values = _intensities(columns)
    if _are_shares(values):
        tell(path, f"{_span(values)} are multiplied by {_LAS_BRIGHTEST}")
        columns = {**columns, "intensity": values * _LAS_BRIGHTEST}
    elif _is_beyond(values, _LAS_BRIGHTEST) or (values != np.floor(values)).any():
        tell(path, f"{_span(values)} become whole numbers from 0 to {_LAS_BRIGHTEST}")
    if "laser_id" in columns:
        return columns
    names = {"laser_id": "ring", "reflectivity": "intensity", "timestamp": "time"}
    others = {name: columns[other] for name, other in names.items() if other in columns}
    return {**_of(columns, *"xyz"), **others}


def _kitti_columns(path: Path, columns: Columns, tell: Tell) -> Columns:
    values = _intensities(columns)
    most = 1 if _are_shares(values) else _KITTI_BRIGHTEST
    if _is_beyond(values, most):
        tell(path, f"{_span(values)} remain as they are, as they are none from 0 to {most}")
        most = 1
    return {**_of(columns, *"xyz"), "intensity": values / most}


def _are_shares(values: NDArray[Any]) -> bool:
    """Return whether intensities are numbers from 0 to 1, not all whole."""
    is_whole = values == np.floor(values)
    return not _is_beyond(values, 1) and not is_whole.all()


def _span(values: NDArray[Any]) -> str:
    return f"intensities from {values.min():g} to {values.max():g}"


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
_POINTS: dict[str, Callable[[Path, Columns, Tell], None]] = {
    ".ply": lambda path, columns, _: write_ply(path, columns),
    ".pcd": lambda path, columns, _: write_pcd(path, _pcd_columns(columns)),
    ".csv": lambda path, columns, _: write_csv(path, columns),
    **dict.fromkeys(
        (".las", ".laz"),
        lambda path, columns, tell: write_las(path, las_columns(path, columns, tell)),
    ),
    ".bin": lambda path, columns, tell: write_float32_frame(
        path, _kitti_columns(path, columns, tell)
    ),
}
OF_POINTS = (*_POINTS,)
"""Suffixes of the formats that take any points."""
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
    suffix = checked_suffix(path, len(source))
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


def export_points(path: Path, columns: Columns, tell: Tell = warn) -> dict[str, Any]:
    """Write points to a file in the format that its suffix names.

    Parameters
    ----------
    path
        File to write, with the suffix .ply, .pcd, .csv, .las, .laz or .bin.
    columns
        Values, (n,), by name of the column: ``x``, ``y``, ``z`` and any others.
    tell
        Function that warns of values that the format changes; by default, they are logged.

    Returns
    -------
    dict
        Number of points (``points``).

    Raises
    ------
    InputError
        The suffix is another one, there are no points, or a coordinate is not finite.
    """
    suffix = checked_suffix(path, len(columns["x"]))
    for axis in "xyz":
        check_finite(f"{path}: {axis}", columns[axis])
    if suffix not in _POINTS:
        raise InputError(f"{path}: a recording has no true coordinates and no scan's columns")
    _POINTS[suffix](path, columns, tell)
    return {"points": len(columns["x"])}


def checked_suffix(path: Path, points: int) -> str:
    """Return the suffix of a file to export to, in lowercase.

    Raises InputError if no format has this suffix, or if the number of `points` is 0.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: unknown suffix {suffix!r} (known: {', '.join(FORMATS)})")
    if points == 0:
        raise InputError(f"{path}: there is no return to export")
    return suffix


def _recorded_columns(source: ReturnTable | Returns) -> Columns:
    if isinstance(source, ReturnTable):
        return _of(source.columns, *_OF_RECORDINGS)
    return columns_of_returns(source, column_us(source))


def columns_of_returns(returns: Returns, sequence_us: float) -> Columns:
    """Return the points of returns, and what is known of each of them, as columns.

    Parameters
    ----------
    returns
        The returns.
    sequence_us
        Time between two columns of a packet, microseconds (`column_us`).

    Returns
    -------
    dict
        Values, (n,), in the order of `Returns.points`: ``x``, ``y``, ``z`` in m, ``ring`` (0 is the
        lowest laser) and, if the returns have them, ``intensity``, and ``time`` in s since the
        packet of the first return.
    """
    table = return_table_of(returns, sequence_us)
    columns = {**_of(table.columns, *"xyz"), "ring": _rings(returns)[table["laser_id"]]}
    if all(turn.reflectivities is not None for turn in returns.turns):
        columns["intensity"] = table["reflectivity"].astype(np.float32)
    if all(turn.times is not None for turn in returns.turns):
        columns["time"] = table["timestamp"]
    return columns


def _rings(returns: Returns) -> NDArray[np.uint16]:
    return np.argsort(returns.layout.order).astype(np.uint16)


def column_us(returns: Returns) -> float:
    """Return the time between two columns of a packet, microseconds; 0 if it is unknown."""
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
