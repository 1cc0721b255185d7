"""Calibration of the range error model from plane residuals, real or virtual (docs/calibration.md).

`calibrate` estimates by maximum likelihood, `write_calibration` makes of it a file that the error
model `calibrated` draws from.
"""

from puckbench.analysis.calibration.calibrating import Calibration, Settings, calibrate
from puckbench.analysis.calibration.fitting import Estimate
from puckbench.analysis.calibration.modelfile import model_file, write_calibration

__all__ = [
    "Calibration",
    "Estimate",
    "Settings",
    "calibrate",
    "model_file",
    "write_calibration",
]
