"""Error models, which change rays, ranges or points of virtual scans, and a lossy receiver."""

from virtual_lidar.errors.model import Draws, ErrorModel, Hits
from virtual_lidar.errors.receiver import Received, Receiver
from virtual_lidar.errors.registry import (
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
    "error_model_names",
    "error_model_title",
    "module_of_model",
    "open_error_model",
]
