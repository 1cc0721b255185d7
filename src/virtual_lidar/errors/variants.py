"""Error models that are another model with other parameters, as ``variants.yaml`` says."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from pydantic import create_model

from pointkit.yaml_files import read_yaml
from virtual_lidar.errors.calibrated import Calibrated
from virtual_lidar.errors.model import ERROR_MODELS, ErrorModel
from virtual_lidar.errors.vlp16 import Vlp16

CODE = ("virtual_lidar.errors.vlp16", "virtual_lidar.errors.calibrated")

_MODELS: dict[str, type[ErrorModel]] = {"calibrated": Calibrated, "vlp16": Vlp16}


def _variant(name: str, entry: dict[str, Any]) -> type[ErrorModel]:
    base, fields = _MODELS[entry["model"]], dict[str, Any]()
    for parameter, value in entry["parameters"].items():
        field = copy.copy(base.model_fields[parameter])
        field.default = value
        fields[parameter] = (field.annotation, field)
    title = "".join(part.capitalize() for part in name.split("_"))
    about = {"__module__": __name__, "__doc__": entry["what"]}
    return _styled(create_model(title, __base__=base, **about, **fields), entry, base)


def _styled(kind: Any, entry: dict[str, Any], base: type[ErrorModel]) -> type[ErrorModel]:
    kind.title, kind.colour, kind.variant_of = entry["title"], entry["colour"], base
    styled: type[ErrorModel] = kind
    return styled


for _name, _entry in read_yaml(Path(__file__).with_suffix(".yaml")).items():
    ERROR_MODELS.register(_name)(_variant(_name, _entry))
