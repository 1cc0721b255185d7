"""Error models, which change rays, ranges or points of virtual scans, and a lossy receiver."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from pointkit.errors import InputError
from pointkit.models import parsed
from pointkit.yaml_files import read_yaml
from virtual_lidar.errors.model import ERROR_MODELS, Draws, ErrorModel, Hits
from virtual_lidar.errors.receiver import Received, Receiver

__all__ = [
    "ERROR_MODELS",
    "Draws",
    "ErrorModel",
    "Hits",
    "ModelStyle",
    "Received",
    "Receiver",
    "error_model_names",
    "error_model_style",
    "error_model_title",
    "module_of_model",
    "open_error_model",
]


def error_model_names() -> list[str]:
    """Return the names of all error models: first those of this package, then those of plug-ins."""
    return ERROR_MODELS.names()


class ModelStyle(NamedTuple):
    """How figures show an error model: its title and colour (``#rrggbb``), or empty texts."""

    title: str = ""
    colour: str = ""


def error_model_style(name: str) -> ModelStyle:
    """Return how figures show an error model.

    Models of this package have their style in ``styles.yaml`` or ``variants.yaml``, others as
    attributes of their class. Parts that none of these defines are empty.
    """
    if name in _styles():
        return ModelStyle(**_styles()[name])
    if name not in ERROR_MODELS:
        return ModelStyle()
    kind = ERROR_MODELS.get(name)
    return ModelStyle(kind.title, kind.colour)


@cache
def _styles() -> dict[str, dict[str, str]]:
    styles: dict[str, dict[str, str]] = read_yaml(Path(__file__).with_name("styles.yaml"))
    return styles


def error_model_title(name: str) -> str:
    """Return an error model's title for figures; a model without a title gets its name as words."""
    words = name.replace("_", " ")
    return error_model_style(name).title or words[:1].upper() + words[1:]


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
