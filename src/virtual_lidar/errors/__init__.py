"""Error models, which change rays, ranges or points of virtual scans, and a lossy receiver."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pointkit.errors import InputError
from pointkit.models import parsed
from virtual_lidar.errors.model import ERROR_MODELS, Draws, ErrorModel, Hits
from virtual_lidar.errors.receiver import Received, Receiver

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


def error_model_names() -> list[str]:
    """Return the names of all error models: those of this package, then those of plug-ins."""
    return ERROR_MODELS.names()


def error_model_title(name: str) -> str:
    """Return an error model's title or, without one, its name as words."""
    title = ERROR_MODELS.get(name).title if name in ERROR_MODELS else ""
    words = name.replace("_", " ")
    return title or words[:1].upper() + words[1:]


def open_error_model(name: str, options: Mapping[str, Any] | None = None) -> ErrorModel:
    """Create an error model with the given parameters.

    Parameters
    ----------
    name
        One of `error_model_names`, or the place of a class of your own, ``module:Class`` or
        ``path/to/file.py:Class``, which `pointkit.registry.trust` must allow.
    options
        Parameters by name; those left out have their defaults. The parameter ``receiver`` holds
        the parameters of a `Receiver`, which then loses returns of the model.

    Raises
    ------
    InputError
        There is no such model, or a parameter is unknown or out of its range.
    """
    kind = ERROR_MODELS.get(name)
    if not (isinstance(kind, type) and issubclass(kind, ErrorModel)):
        raise InputError(f"error model {name}: not a class of virtual_lidar.errors.ErrorModel")
    values = dict(options or {})
    receiver = values.pop("receiver", None)
    what = f"error model {name}"
    model = parsed(kind, values, what)
    if receiver is None:
        return model
    return Received(model=model, receiver=parsed(Receiver, receiver, f"{what}: receiver"))


def module_of_model(model: ErrorModel) -> str:
    """Return the name of the module that defines an error model, with or without a receiver."""
    return type(model.model if isinstance(model, Received) else model).__module__
