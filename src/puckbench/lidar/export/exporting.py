"""Export by the suffix of the file to write."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.io.evd import write_evd
from puckbench.io.las import write_las, write_laz
from puckbench.io.point_formats import Rows, write_csv, write_pcd, write_ply
from puckbench.lidar.export.rows import capture_rows, scan_rows
from puckbench.lidar.recordings.capture_table import CaptureTable, read_capture_table
from puckbench.lidar.recordings.writing import write_pcap
from puckbench.lidar.scan_table import ScanTable, read_scan

Source = ScanTable | CaptureTable

# What takes any rows of points, and what takes a virtual scan with all its columns.
_POINTS: dict[str, Callable[[Path, Rows], None]] = {
    ".ply": write_ply,
    ".pcd": write_pcd,
    ".csv": write_csv,
    ".las": write_las,
    ".laz": write_laz,
}
FORMATS = (*_POINTS, ".evd", ".pcap")


def read_source(path: Path) -> Source:
    """A scan table or a capture table; InputError when the file is neither."""
    from pyarrow import ArrowException, parquet

    try:
        metadata = parquet.read_schema(path).metadata or {}
    except (OSError, ArrowException):
        return read_scan(path)
    is_capture = CaptureTable.declared.key.encode() in metadata
    return read_capture_table(path) if is_capture else read_scan(path)


def export(path: Path, source: Source, clean: bool = False) -> dict[str, Any]:
    """Write `source` in the format of `path`'s suffix, whole or not at all; what was written.

    Measured coordinates, or the true ones when `clean`; BlenSor's format has both. Raises
    InputError for an unknown suffix, no rows, or a capture where only a scan will do.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: unknown suffix {suffix!r} (known: {', '.join(FORMATS)})")
    if len(source) == 0:
        raise InputError(f"{path}: there is no return to export")
    if isinstance(source, CaptureTable):
        if clean or suffix not in _POINTS:
            raise InputError(
                f"{path}: a real capture has no true coordinates and no scan's columns"
            )
        _POINTS[suffix](path, capture_rows(source))
    elif suffix in _POINTS:
        _POINTS[suffix](path, scan_rows(source, clean))
    elif suffix == ".evd":
        write_evd(path, source)
    else:
        return {"points": len(source), **write_pcap(path, source, noisy=not clean)}
    return {"points": len(source)}
