"""Calibration of the range error model from plane residuals, real or virtual.

The model and its estimate are explained in docs/explanation/sensor.md.

`calibrate` estimates by maximum likelihood, `write_calibration` makes of it a file that the error
model `calibrated` draws from.
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
