from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pointkit.errors import InputError
from pointkit.models import parsed
from pointkit.registry import Registry
from virtual_lidar.errors.model import ErrorModel
from virtual_lidar.errors.receiver import Received, Receiver

ERROR_MODELS: Registry[type[ErrorModel]] = Registry("error model", "errors", "virtual_lidar")


def error_model_names() -> list[str]:
    return ERROR_MODELS.names()


def error_model_title(name: str) -> str:
    """Return an error model's title or, without one, its name as words."""
    title = ERROR_MODELS.get(name).title if name in ERROR_MODELS else ""
    words = name.replace("_", " ")
    return title or words[:1].upper() + words[1:]


def open_error_model(name: str, options: Mapping[str, Any] | None = None) -> ErrorModel:
    """Open an error model by registered name, ``module:Class`` or ``path/to/file.py:Class``.

    The option ``receiver`` holds the parameters of a `Receiver`.
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
    return type(model.model if isinstance(model, Received) else model).__module__
