"""Rotating LiDARs: sensors, virtual scans with error models, and recordings of real sensors."""

from puckbench.lidar.errors import ErrorModel, error_model_names, open_error_model
from puckbench.lidar.placement import free_origin
from puckbench.lidar.scan import ScanJob, scan
from puckbench.lidar.scan_table import (
    COLUMNS,
    ScanTable,
    read_scan,
    write_scan,
    write_scan_portions,
)
from puckbench.lidar.sensor import Sensor, load_sensor, sensor_names
from puckbench.lidar.sweep import SWEEPS, Sweep, open_sweep

__all__ = [
    "COLUMNS",
    "SWEEPS",
    "ErrorModel",
    "ScanJob",
    "ScanTable",
    "Sensor",
    "Sweep",
    "error_model_names",
    "free_origin",
    "load_sensor",
    "open_error_model",
    "open_sweep",
    "read_scan",
    "scan",
    "sensor_names",
    "write_scan",
    "write_scan_portions",
]
