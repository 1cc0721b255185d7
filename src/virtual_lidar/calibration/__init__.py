"""Estimation of the parameters of a LiDAR's range errors from the residuals of planes.

docs/explanation/sensor.md explains the method.
"""

from virtual_lidar.calibration.calibrating import Calibration, CalibrationOptions, calibrate
from virtual_lidar.calibration.files import model_file, write_calibration
from virtual_lidar.calibration.fitting import Estimate

__all__ = [
    "Calibration",
    "CalibrationOptions",
    "Estimate",
    "calibrate",
    "model_file",
    "write_calibration",
]
