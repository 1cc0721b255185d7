"""Error models of the virtual sensor: one file each, and one line each in the registry.

Any of them can be followed by a receiver (attenuation, raydrop, minimum range, range quantum).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from importlib import import_module
from typing import Any

from puckbench.core.errors import InputError
from puckbench.lidar.errors.model import Draws, ErrorModel, Hits
from puckbench.lidar.errors.receiver import Received, Receiver
from puckbench.lidar.options import from_options

__all__ = [
    "REGISTRY",
    "Draws",
    "ErrorModel",
    "Hits",
    "Received",
    "Receiver",
    "described",
    "error_model_names",
    "module_of_model",
    "open_error_model",
]

# name: (module:class, values that differ from the class's own)
REGISTRY: dict[str, tuple[str, dict[str, Any]]] = {
    "none": ("puckbench.lidar.errors.none:NoErrors", {}),
    "vlp16": ("puckbench.lidar.errors.vlp16:Vlp16", {}),
    "vlp16_divergence": ("puckbench.lidar.errors.vlp16_divergence:Vlp16Divergence", {}),
    "vlp16_incidence": ("puckbench.lidar.errors.vlp16_incidence:Vlp16Incidence", {}),
    # As Table 5.1 prints the VLP-16, against the text of 5.4 and the code.
    "vlp16_table51": (
        "puckbench.lidar.errors.vlp16:Vlp16",
        {"bias_sigma_m": 0.078, "ray_sigma_m": 0.014},
    ),
    # BlenSor's defaults, which are the HDL-64E's.
    "hdl64e": (
        "puckbench.lidar.errors.vlp16:Vlp16",
        {"bias_sigma_m": 0.078, "ray_sigma_m": 0.010},
    ),
    "surface_normal": ("puckbench.lidar.errors.surface_normal:SurfaceNormal", {}),
    "beam_footprint": ("puckbench.lidar.errors.beam_footprint:BeamFootprint", {}),
    "distance_table": ("puckbench.lidar.errors.distance_table:DistanceTable", {}),
    "calibrated": ("puckbench.lidar.errors.calibrated:Calibrated", {}),
    # Calibrated on captures of real sensors: calibrations/vlp16_measured.yaml.
    "vlp16_measured": (
        "puckbench.lidar.errors.calibrated:Calibrated",
        {"file": "vlp16_measured"},
    ),
    # The room scans as run: ray sigma is the default of BlenSor's scan_range, and no divergence.
    "thesis_room": ("puckbench.lidar.errors.vlp16:Vlp16", {"ray_sigma_m": 0.020}),
}


def error_model_names() -> list[str]:
    """Names that `open_error_model` knows."""
    return list(REGISTRY)


def open_error_model(name: str, options: Mapping[str, Any] | None = None) -> ErrorModel:
    """The error model `name` with some of its parameters replaced by `options`.

    The option ``receiver`` of any model holds the parameters of a `Receiver`. Raises InputError for
    an unknown model or option.
    """
    if name not in REGISTRY:
        raise InputError(f"unknown error model {name!r} (known: {', '.join(REGISTRY)})")
    target, preset = REGISTRY[name]
    module, _, kind = target.partition(":")
    parameters: type[ErrorModel] = getattr(import_module(module), kind)
    values = {**preset, **(options or {})}
    receiver = values.pop("receiver", None)
    model = from_options(parameters, values, f"error model {name}")
    return model if receiver is None else Received(model, _receiver(receiver, name))


def module_of_model(model: ErrorModel) -> str:
    """Dotted name of the module that a model is defined in, its receiver left aside."""
    return type(model.model if isinstance(model, Received) else model).__module__


def described(model: ErrorModel) -> dict[str, Any]:
    """A model's class and parameters, and its receiver's if it has one."""
    if isinstance(model, Received):
        return {**described(model.model), "receiver": asdict(model.receiver)}
    parameters: Any = model
    return {"model": type(model).__name__, **asdict(parameters)}


def _receiver(options: Any, name: str) -> Receiver:
    what = f"error model {name}: receiver"
    if not isinstance(options, Mapping):
        raise InputError(f"{what} is {options!r}, but must be options by name")
    return from_options(Receiver, options, what)
