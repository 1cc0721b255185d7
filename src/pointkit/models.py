"""Base class of checked options, with error messages of one line that say what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from pointkit.errors import InputError, closest

M = TypeVar("M", bound=BaseModel)


class Model(BaseModel):
    """Base class of immutable records of options.

    A record rejects unknown names of options, and converts no values to other types.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_by_name=True
    )

    def replaced(self, **changes: Any) -> Self:
        """Return a copy in which some options have other values; the copy is checked."""
        return type(self).model_validate({**dict(self), **changes})


def parsed(model: type[M], values: Any, what: str) -> M:
    """Create a record of options from values of a configuration or the command line.

    Parameters
    ----------
    model
        Class of the record.
    values
        Values of the options by name. A list is accepted for a tuple, and an integer for a float.
    what
        Beginning of error messages.

    Returns
    -------
    Model
        The record, an instance of `model`.

    Raises
    ------
    InputError
        A value is invalid; the message names the option, the value and the allowed values.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{what} is {values!r}, but must be a mapping of options")
    try:
        return model.model_validate(_immutable(values))
    except ValidationError as error:
        raise InputError(f"{what}: {_Fault.of(error, values, model).line('option')}") from error
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def checked_model(model: type[M], values: Mapping[str, Any]) -> M:
    """Create a record from a configuration; raise InputError that names the invalid key."""
    try:
        return model.model_validate(_immutable(values))
    except ValidationError as error:
        raise InputError(_Fault.of(error, values, model).placed_line()) from error


def _immutable(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _immutable(item) for name, item in value.items()}
    return tuple(map(_immutable, value)) if isinstance(value, list) else value


@dataclass(frozen=True)
class _Fault:
    where: tuple[str, ...]
    kind: str
    value: Any
    allowed: str
    names: list[str]

    @classmethod
    def of(cls, error: ValidationError, values: Mapping[str, Any], model: Any) -> _Fault:
        faults = [(_place(each["loc"], values, each["type"]), each) for each in error.errors()]
        where, first = max(faults, key=lambda item: (len(item[0]), item[1]["type"] != "missing"))
        allowed = dict.fromkeys(_allowed(each) for place, each in faults if place == where)
        names = _option_names(model, where[:-1])
        return cls(where, first["type"], first["input"], " or ".join(allowed), names)

    def line(self, noun: str) -> str:
        name = ".".join(self.where)
        if self.kind == "extra_forbidden":
            listed = f" (known: {', '.join(self.names)})" if self.names else ""
            return f"unknown {noun} '{name}'{listed}{closest(self.where[-1], self.names)}"
        if self.kind == "missing":
            return f"the {noun} '{name}' is missing"
        if self.kind == "value_error":
            return f"{name}: {self.allowed}" if name else self.allowed
        must = self.allowed if self.allowed.startswith("have ") else f"be {self.allowed}"
        return f"{name} is {self.value!r}, but must {must}"

    def placed_line(self) -> str:
        if self.kind not in {"extra_forbidden", "missing"}:
            return self.line("key")
        place = ".".join(self.where[:-1]) or "the configuration"
        inner = _Fault(self.where[-1:], self.kind, self.value, self.allowed, self.names)
        return f"{place}: {inner.line('key')}"


def _place(location: tuple[int | str, ...], values: Any, kind: str) -> tuple[str, ...]:
    keys: list[str] = []
    for number, part in enumerate(location):
        absent = kind == "missing" and number == len(location) - 1
        if isinstance(values, Mapping) and (part in values or absent):
            values = values.get(part)
        elif isinstance(values, (list, tuple)) and isinstance(part, int):
            values = values[part] if part < len(values) else None
        else:
            continue
        keys.append(str(part))
    return tuple(keys)


def _allowed(fault: Any) -> str:
    context = fault.get("ctx", {})
    if fault["type"] == "value_error":
        return str(context["error"])
    if fault["type"] in {"literal_error", "enum"}:
        return str(context["expected"])
    if fault["type"] == "too_short":
        return f"have at least {context['min_length']}"
    message = str(fault["msg"]).replace("Input should be ", "")
    message = message.replace("a valid tuple", "a list")
    return message.replace("String should match pattern", "a name that matches")


def _option_names(model: Any, where: tuple[str, ...]) -> list[str]:
    for name in where:
        fields = _fields(model)
        model = fields.get(name, next(iter(fields.values()), None)) if fields else None
    return list(_fields(model))


def _fields(kind: Any) -> dict[str, Any]:
    if hasattr(kind, "model_fields"):
        return {field.alias or name: field.annotation for name, field in kind.model_fields.items()}
    parts = [part for part in get_args(kind) if hasattr(part, "model_fields") or get_args(part)]
    if getattr(kind, "__origin__", None) is dict:
        return {"*": get_args(kind)[1]}
    return next((fields for part in parts if (fields := _fields(part))), {})
