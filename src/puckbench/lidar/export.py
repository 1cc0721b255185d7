"""Export of scans and recordings to other tools' formats, chosen by the suffix of the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.io.evd import write_evd
from puckbench.io.las import write_las
from puckbench.io.parquet_files import parquet_metadata
from puckbench.io.pcd import write_pcd
from puckbench.io.ply import write_ply
from puckbench.io.text import write_csv
from puckbench.lidar.recordings.returns import RecordedReturns, read_returns
from puckbench.lidar.recordings.writing import write_pcap
from puckbench.lidar.scan_table import ScanTable, read_scan

Source = ScanTable | RecordedReturns
Columns = dict[str, NDArray[Any]]

# These formats take any columns of points; the others take virtual scans only.
_POINTS: dict[str, Callable[[Path, Mapping[str, NDArray[Any]]], None]] = {
    ".ply": write_ply,
    ".pcd": write_pcd,
    ".csv": write_csv,
    ".las": write_las,
    ".laz": write_las,
}
FORMATS = (*_POINTS, ".evd", ".pcap")

_OF_SCANS = (
    *("timestamp", "frame", "laser_id", "yaw", "pitch", "incidence", "object_id", "primitive_id"),
    *("nx", "ny", "nz"),
)
_OF_RECORDINGS = (
    *("x", "y", "z", "timestamp", "turn", "laser_id", "return_kind", "azimuth", "elevation"),
    *("distance", "reflectivity"),
)


def read_source(path: Path) -> Source:
    is_capture = RecordedReturns.schema.metadata_key.encode() in parquet_metadata(path)
    return read_returns(path) if is_capture else read_scan(path)


def export(path: Path, source: Source, clean: bool = False) -> dict[str, Any]:
    """Write a scan or recording in the format of the path's suffix; return numbers of points.

    With `clean`, write true coordinates; BlenSor's format (.evd) contains both.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: unknown suffix {suffix!r} (known: {', '.join(FORMATS)})")
    if len(source) == 0:
        raise InputError(f"{path}: there is no return to export")
    if isinstance(source, RecordedReturns):
        if clean or suffix not in _POINTS:
            raise InputError(f"{path}: a recording has no true coordinates and no scan's columns")
        _POINTS[suffix](path, {name: source[name] for name in _OF_RECORDINGS})
    elif suffix in _POINTS:
        _POINTS[suffix](path, _scan_columns(source, clean))
    elif suffix == ".evd":
        write_evd(path, source)
    else:
        return {"points": len(source), **write_pcap(path, source, noisy=not clean)}
    return {"points": len(source)}


def _scan_columns(table: ScanTable, clean: bool) -> Columns:
    suffix = "" if clean else "_noisy"
    measured = {name: table[name + suffix] for name in ("x", "y", "z", "distance")}
    optional = {"reflectivity"} & set(table.columns)
    return {**measured, **{name: table[name] for name in (*_OF_SCANS, *optional)}}
