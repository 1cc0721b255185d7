"""Error models of virtual sensors, one in each module, and the model of the receiver.

An error model changes rays, ranges or points; the receiver decides which returns are lost.
"""

from puckbench.lidar.errors.model import Draws, ErrorModel, Hits, described
from puckbench.lidar.errors.receiver import Received, Receiver
from puckbench.lidar.errors.registry import (
    ERROR_MODELS,
    error_model_names,
    error_model_title,
    module_of_model,
    open_error_model,
)

__all__ = [
    "ERROR_MODELS",
    "Draws",
    "ErrorModel",
    "Hits",
    "Received",
    "Receiver",
    "described",
    "error_model_names",
    "error_model_title",
    "module_of_model",
    "open_error_model",
]
