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
    """Return the names of all error models: first those of this package, then those of plug-ins."""
    return ERROR_MODELS.names()


def error_model_title(name: str) -> str:
    """Return an error model's title for figures; a model without a title gets its name as words."""
    title = ERROR_MODELS.get(name).title if name in ERROR_MODELS else ""
    words = name.replace("_", " ")
    return title or words[:1].upper() + words[1:]


def open_error_model(name: str, options: Mapping[str, Any] | None = None) -> ErrorModel:
    """Create an error model, which says how measurements of a virtual scan deviate from the truth.

    Parameters
    ----------
    name
        One of `error_model_names`. For a class of your own, it is the place of the class:
        ``module:Class`` or ``path/to/file.py:Class``. `pointkit.registry.trust` must allow this
        place.
    options
        Parameters of the model by name. Parameters that are left out have their defaults. The
        additional parameter ``receiver`` holds the parameters of a `Receiver`, which loses some of
        the model's returns.

    Returns
    -------
    ErrorModel
        The model with checked parameters, to be passed to `scan`.

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
