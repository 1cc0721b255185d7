from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pointkit.errors import InputError
from pointkit.models import parsed
from pointkit.registry import Registry
from puckbench.datasets.base import DataSet

LOADERS: Registry[type[DataSet]] = Registry("loader", "datasets")
"""Classes that read or generate data sets, by the configuration's `loader`."""


def loader_class(loader: str) -> type[DataSet]:
    """Return the class of a loader; raise InputError if it is not a complete data set."""
    model = LOADERS.get(loader)
    if not (isinstance(model, type) and issubclass(model, DataSet)):
        base = f"{DataSet.__module__}.{DataSet.__name__}"
        raise InputError(f"loader {loader}: not a class derived from {base}")
    if missing := sorted(model.__abstractmethods__):
        raise InputError(f"loader {loader}: {model.__name__} lacks {', '.join(missing)}")
    return model


def open_scene_set(loader: str, options: Mapping[str, Any], seed: int = 0) -> DataSet:
    """Create a data set from its name in `LOADERS`, ``module:Class`` or ``path/to/file.py:Class``.

    The field ``seed`` is set to `seed` unless `options` sets it.
    """
    model = loader_class(loader)
    settings = {"seed": seed, **options} if "seed" in model.model_fields else dict(options)
    return parsed(model, settings, f"loader {loader}")
