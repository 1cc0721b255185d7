from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pointkit.errors import InputError
from pointkit.models import parsed
from pointkit.registry import Registry
from puckbench.scene_sets.base import SceneSet
from puckbench.scene_sets.old_names import keep_old_names

LOADERS: Registry[type[SceneSet]] = Registry("loader", "scene_sets")
"""Registry of the classes that read or generate scene sets. A configuration names them as
`loader`."""


def loader_class(loader: str) -> type[SceneSet]:
    """Return the class that reads or generates a scene set.

    Parameters
    ----------
    loader
        A name in `LOADERS`, ``module:Class`` or ``path/to/file.py:Class``.

    Raises
    ------
    InputError
        It is unknown, or not a complete class derived from `SceneSet`.
    """
    model = LOADERS.get(loader)
    if not (isinstance(model, type) and issubclass(model, SceneSet)):
        base = f"{SceneSet.__module__}.{SceneSet.__name__}"
        raise InputError(f"loader {loader}: not a class derived from {base}")
    if not model.__module__.startswith("puckbench."):
        keep_old_names(model)
    if missing := sorted(model.__abstractmethods__):
        raise InputError(f"loader {loader}: {model.__name__} lacks {', '.join(missing)}")
    return model


def open_scene_set(loader: str, options: Mapping[str, Any], seed: int = 0) -> SceneSet:
    """Open a scene set.

    Parameters
    ----------
    loader
        A name in `LOADERS`, ``module:Class`` or ``path/to/file.py:Class``.
    options
        Values of the options by name.
    seed
        Value of the option ``seed``, if the loader has this option and `options` does not set it.

    Raises
    ------
    InputError
        The loader or an option is unknown or invalid.
    """
    model = loader_class(loader)
    settings = {"seed": seed, **options} if "seed" in model.model_fields else dict(options)
    return parsed(model, settings, f"loader {loader}")
