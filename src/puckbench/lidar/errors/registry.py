"""The error models by name, and opening them by name and options."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from puckbench.core.errors import InputError
from puckbench.core.models import parsed
from puckbench.core.registry import Registry
from puckbench.lidar.errors.model import ErrorModel
from puckbench.lidar.errors.receiver import Received, Receiver

ERROR_MODELS: Registry[type[ErrorModel]] = Registry("error model", "errors")


def error_model_names() -> list[str]:
    """Names of our error models and of those of installed packages."""
    return ERROR_MODELS.names()


def open_error_model(name: str, options: Mapping[str, Any] | None = None) -> ErrorModel:
    """Open an error model with some of its parameters replaced.

    Parameters
    ----------
    name
        A registered name, ``module:Class`` or ``path/to/file.py:Class``.
    options
        Parameters by name; ``receiver``, for any model, has those of a `Receiver`.

    Raises
    ------
    InputError
        For an unknown model or option, or a wrong value.
    """
    kind = ERROR_MODELS.get(name)
    if not (isinstance(kind, type) and issubclass(kind, ErrorModel)):
        raise InputError(f"error model {name}: not a class of puckbench.lidar.errors.ErrorModel")
    values = dict(options or {})
    receiver = values.pop("receiver", None)
    what = f"error model {name}"
    model = parsed(kind, values, what)
    if receiver is None:
        return model
    return Received(model=model, receiver=parsed(Receiver, receiver, f"{what}: receiver"))


def module_of_model(model: ErrorModel) -> str:
    """Dotted name of the module that a model is defined in, its receiver left aside."""
    return type(model.model if isinstance(model, Received) else model).__module__
