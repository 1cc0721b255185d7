"""Virtual scans of meshes by rotating LiDARs, with models of their errors."""

from virtual_lidar.errors import ErrorModel, error_model_names, open_error_model
from virtual_lidar.placement import free_origin
from virtual_lidar.scan_table import COLUMNS, ScanTable, read_scan, write_scan, write_scan_portions
from virtual_lidar.scanning import ScanJob, scan
from virtual_lidar.sweep import SWEEPS, Sweep, open_sweep

__all__ = [
    "COLUMNS",
    "SWEEPS",
    "ErrorModel",
    "ScanJob",
    "ScanTable",
    "Sweep",
    "error_model_names",
    "free_origin",
    "open_error_model",
    "open_sweep",
    "read_scan",
    "scan",
    "write_scan",
    "write_scan_portions",
]
