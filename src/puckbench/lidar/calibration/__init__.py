"""Estimation of the parameters of range errors from residuals of planes, measured or simulated.

docs/explanation/sensor.md explains the model and its estimation.
"""

from puckbench.lidar.calibration.calibrating import Calibration, CalibrationOptions, calibrate
from puckbench.lidar.calibration.files import model_file, write_calibration
from puckbench.lidar.calibration.fitting import Estimate

__all__ = [
    "Calibration",
    "CalibrationOptions",
    "Estimate",
    "calibrate",
    "model_file",
    "write_calibration",
]
