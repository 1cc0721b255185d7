from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, cast, get_type_hints

import pydantic

from puckbench.core.errors import InputError
from puckbench.core.models import Model, parsed
from puckbench.core.registry import Registry
from puckbench.datasets.scene import SceneSet

LOADERS: Registry[type[SceneSet]] = Registry("loader", "datasets")
"""Classes that read or generate data sets, by the configuration's `loader`."""


def open_scene_set(loader: str, options: Mapping[str, Any], seed: int = 0) -> SceneSet:
    """Create a data set from its name in `LOADERS`, ``module:Class`` or ``path/to/file.py:Class``.

    The class is a pydantic model (`puckbench.core.models.Model`) or a frozen data class. The field
    ``seed`` is set to `seed` unless `options` sets it.
    """
    loader_class = LOADERS.get(loader)
    model = options_model(loader_class, f"loader {loader}")
    settings = {"seed": seed, **options} if "seed" in model.model_fields else dict(options)
    values = parsed(model, settings, f"loader {loader}")
    return loader_class(**dict(values))


def options_model(loader_class: type, what: str) -> type[pydantic.BaseModel]:
    if issubclass(loader_class, pydantic.BaseModel):
        return loader_class
    if not is_dataclass(loader_class):
        raise InputError(
            f"{what}: {loader_class.__name__} is neither a data class nor a pydantic model"
        )
    try:
        hints = get_type_hints(loader_class, include_extras=True)
    except NameError as error:
        raise InputError(f"{what}: the types of its options: {error}") from error
    options: dict[str, Any] = {
        item.name: (hints[item.name], _default(item)) for item in fields(loader_class) if item.init
    }
    config = {**Model.model_config, "arbitrary_types_allowed": True}
    return pydantic.create_model(
        loader_class.__name__, __config__=cast("pydantic.ConfigDict", config), **options
    )


def _default(item: Field[Any]) -> Any:
    if item.default_factory is not MISSING:
        return pydantic.Field(default_factory=item.default_factory)
    return ... if item.default is MISSING else item.default
