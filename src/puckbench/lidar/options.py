"""Parameters from a configuration: loose names and values to a frozen dataclass, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from puckbench.core.errors import InputError

T = TypeVar("T")


def from_options(parameters: type[T], options: Mapping[str, Any], what: str) -> T:
    """Make the dataclass `parameters` from `options`; `what` names their source in errors.

    Raises InputError for an unknown name, a missing name or a value of the wrong type.
    """
    hints, entries = get_type_hints(parameters), _fields(parameters)
    known = {name: hints[name] for name in entries}
    for name in options:
        if name not in known:
            raise InputError(f"{what}: unknown option {name!r} (known: {', '.join(known)})")
    if lacking := [name for name in entries if entries[name] and name not in options]:
        raise InputError(f"{what}: lacks {', '.join(lacking)}")
    values = {
        name: _converted(value, known[name], f"{what}: {name}") for name, value in options.items()
    }
    try:
        return parameters(**values)
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def _fields(parameters: type) -> dict[str, bool]:
    """Names of a dataclass's fields, and whether each must be given."""
    return {
        field.name: field.default is MISSING and field.default_factory is MISSING
        for field in fields(parameters)
    }


def check_at_least(parameters: object, least: float, *names: str) -> None:
    """InputError unless the named numbers (or None) of `parameters` are at least `least`."""
    for name in names:
        value = getattr(parameters, name)
        if value is not None and value < least:
            raise InputError(f"{name} is {value}, but must be at least {least:g}")


def check_above_zero(parameters: object, *names: str) -> None:
    """InputError unless the named numbers (or None) of `parameters` are greater than zero."""
    for name in names:
        value = getattr(parameters, name)
        if value is not None and value <= 0:
            raise InputError(f"{name} is {value}, but must be greater than 0")


def _converted(value: Any, hint: Any, what: str) -> Any:
    """`value` as the type `hint` (int, float, str, bool, a collection, or one or None)."""
    if type(None) in get_args(hint):
        if value is None:
            return None
        hint = next(kind for kind in get_args(hint) if kind is not type(None))
    if hint is float:
        return _number(value, what)
    if get_origin(hint) in {tuple, dict}:
        return _collection(value, hint, what)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise InputError(f"{what} is {value!r}, but must be of type {hint.__name__}")
    return value


_COLLECTIONS: dict[Any, str] = {
    tuple[float, ...]: "a list of numbers",
    tuple[str, ...]: "a list of words",
    tuple[tuple[float, ...], ...]: "a list of lists of numbers",
    dict[str, float]: "numbers by name",
}


def _collection(value: Any, hint: Any, what: str) -> Any:
    if get_origin(hint) is tuple and isinstance(value, (list, tuple)):
        return tuple(_converted(entry, get_args(hint)[0], what) for entry in value)
    if get_origin(hint) is dict and isinstance(value, Mapping):
        return {
            _converted(name, str, f"a name in {what}"): _number(entry, f"{what}: {name}")
            for name, entry in value.items()
        }
    raise InputError(f"{what} is {value!r}, but must be {_COLLECTIONS[hint]}")


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(f"{what} is {value!r}, but must be a finite number")
    return float(value)
