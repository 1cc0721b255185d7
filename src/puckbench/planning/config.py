"""The configuration: checked against its schema, defaults filled in, every error one line."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError

Config = dict[str, Any]


def checked(config: Mapping[str, Any], schema: Mapping[str, Any]) -> Config:
    """The configuration with the schema's defaults; InputError names the key and what is allowed.

    Where it asks for stand-ins, they have taken their places. Only the schema is checked here;
    names of loaders, codecs and rates are checked by `plan`.
    """
    from jsonschema import Draft202012Validator

    filled: Config = with_stand_ins(config)
    if filled.get("timing") == "exclusive":
        filled["timing"] = {"exclusive": True}
    _fill_defaults(filled, schema, schema)
    errors = sorted(Draft202012Validator(schema).iter_errors(filled), key=lambda e: len(e.path))
    if errors:
        raise InputError(_one_line(errors[0]))
    return filled


def with_stand_ins(config: Mapping[str, Any]) -> Config:
    """A copy in which generated data stand in for those on disk, where `stand_in` is true.

    A scene set's `stand_in` is used in its place; a data set's, and that of the figures, changes
    the keys that it names. Results go to a folder of their own.
    """
    changed: Config = copy.deepcopy(dict(config))
    wanted = changed.get("stand_in")
    if wanted in ("true", "false"):  # as Snakemake's --config hands it over
        wanted = changed["stand_in"] = wanted == "true"
    if wanted is not True:
        return changed
    changed["results"] = f"{changed.get('results', 'results')}_stand_in"
    for scenes in _mappings(changed.get("scenes")):
        stand_in = scenes.get("stand_in")
        if isinstance(stand_in, dict):
            scenes.clear()
            scenes.update(stand_in)
    for entry in (*_mappings(changed.get("datasets")), *_mappings([changed.get("figures")])):
        stand_in = entry.get("stand_in")
        if isinstance(stand_in, dict):
            entry.update(entry.pop("stand_in"))
    return changed


def _mappings(values: Any) -> list[Config]:
    """Those of the values (of a mapping, or of a list) that are mappings themselves."""
    found = values.values() if isinstance(values, dict) else values or ()
    return [value for value in found if isinstance(value, dict)]


def read_schema(path: Path) -> Config:
    """The schema, a YAML file."""
    import yaml

    schema: Config = yaml.safe_load(path.read_text(encoding="utf-8"))
    return schema


def _fill_defaults(value: Any, schema: Mapping[str, Any], root: Mapping[str, Any]) -> None:
    """Set the defaults of absent properties, at every depth that the schema describes."""
    schema = _resolved(schema, root)
    if not isinstance(value, dict):
        return
    for key, child in schema.get("properties", {}).items():
        default = _resolved(child, root).get("default")
        if key not in value and default is not None:
            value[key] = copy.deepcopy(default)
        if key in value:
            _fill_defaults(value[key], child, root)
    others = schema.get("additionalProperties")
    if isinstance(others, Mapping):
        for key in value.keys() - schema.get("properties", {}).keys():
            _fill_defaults(value[key], others, root)


def _resolved(schema: Mapping[str, Any], root: Mapping[str, Any]) -> Mapping[str, Any]:
    reference = schema.get("$ref")
    if reference is None:
        return schema
    target: Mapping[str, Any] = root["$defs"][reference.rsplit("/", 1)[1]]
    return target


def _one_line(error: Any) -> str:
    where = ".".join(str(part) for part in error.absolute_path) or "the configuration"
    if error.validator == "additionalProperties":
        known = sorted(error.schema.get("properties", {}))
        unknown = sorted(set(error.instance) - set(known))
        return f"{where}: unknown key '{unknown[0]}' (known: {', '.join(known)})"
    if error.validator == "enum":
        allowed = ", ".join(str(value) for value in error.validator_value)
        return f"{where}: '{error.instance}' is not allowed (allowed: {allowed})"
    return f"{where}: {' '.join(error.message.split())[:200]}"
