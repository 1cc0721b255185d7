"""Options and configuration as pydantic models, whose errors are one clear line each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from puckbench.core.errors import InputError, closest

M = TypeVar("M", bound=BaseModel)


class Model(BaseModel):
    """A frozen record of options: unknown names are refused, words are never read as numbers."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_by_name=True
    )

    def replaced(self, **changes: Any) -> Self:
        """The record with some of its values replaced, and all checked again."""
        return type(self).model_validate({**dict(self), **changes})


def parsed(model: type[M], values: Any, what: str) -> M:
    """Make a model from loose values, as a configuration or a command line gives them.

    Parameters
    ----------
    model
        The class of the options.
    values
        Names and values; lists stand for tuples, whole numbers for any numbers.
    what
        What the options are for, which begins the line of an error.

    Raises
    ------
    InputError
        The first fault in one line: the option, its value, and what is allowed.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{what} is {values!r}, but must be options by name")
    try:
        return model.model_validate(_immutable(values))
    except ValidationError as error:
        raise InputError(f"{what}: {_Fault.of(error, values, model).line('option')}") from error
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def checked_model(model: type[M], values: Mapping[str, Any]) -> M:
    """Make a model from a whole configuration; an InputError begins with the key at fault."""
    try:
        return model.model_validate(_immutable(values))
    except ValidationError as error:
        raise InputError(_Fault.of(error, values, model).placed_line()) from error


def _immutable(value: Any) -> Any:
    """Lists as tuples, at every depth: strict models take no list for a tuple."""
    if isinstance(value, Mapping):
        return {name: _immutable(item) for name, item in value.items()}
    return tuple(map(_immutable, value)) if isinstance(value, list) else value


@dataclass(frozen=True)
class _Fault:
    """One fault of some values: where it is, what kind it has, and what is allowed there."""

    where: tuple[str, ...]
    kind: str
    value: Any
    said: str
    known: list[str]

    @classmethod
    def of(cls, error: ValidationError, values: Mapping[str, Any], model: Any) -> _Fault:
        """The deepest fault of a validation; branches of one union are reported together."""
        found = [(_place(one["loc"], values, one["type"]), one) for one in error.errors()]
        where, first = max(found, key=lambda item: (len(item[0]), item[1]["type"] != "missing"))
        alike = [one for place, one in found if place == where]
        said = " or ".join(dict.fromkeys(map(_said, alike)))
        return cls(where, first["type"], first["input"], said, _known(model, where[:-1]))

    def line(self, noun: str) -> str:
        """The fault with the whole path of the option in it."""
        name = ".".join(self.where)
        if self.kind == "extra_forbidden":
            listed = f" (known: {', '.join(self.known)})" if self.known else ""
            return f"unknown {noun} '{name}'{listed}{closest(self.where[-1], self.known)}"
        if self.kind == "missing":
            return f"the {noun} '{name}' is missing"
        if self.kind == "value_error":
            return f"{name}: {self.said}" if name else self.said
        must = self.said if self.said.startswith("have ") else f"be {self.said}"
        return f"{name} is {self.value!r}, but must {must}"

    def placed_line(self) -> str:
        """The fault after the place of the key in a configuration."""
        if self.kind not in {"extra_forbidden", "missing"}:
            return self.line("key")
        place = ".".join(self.where[:-1]) or "the configuration"
        inner = _Fault(self.where[-1:], self.kind, self.value, self.said, self.known)
        return f"{place}: {inner.line('key')}"


def _place(location: tuple[int | str, ...], values: Any, kind: str) -> tuple[str, ...]:
    """The keys of a location: names of a union's branches are left out."""
    found: list[str] = []
    for number, part in enumerate(location):
        absent = kind == "missing" and number == len(location) - 1
        if isinstance(values, Mapping) and (part in values or absent):
            values = values.get(part)
        elif isinstance(values, (list, tuple)) and isinstance(part, int):
            values = values[part] if part < len(values) else None
        else:
            continue
        found.append(str(part))
    return tuple(found)


def _said(fault: Any) -> str:
    """What is allowed, in words that follow "must" or "must be"."""
    context = fault.get("ctx", {})
    if fault["type"] == "value_error":
        return str(context["error"])
    if fault["type"] in {"literal_error", "enum"}:
        return str(context["expected"])
    if fault["type"] == "too_short":
        return f"have at least {context['min_length']}"
    said = str(fault["msg"]).replace("Input should be ", "")
    said = said.replace("a valid tuple", "a list")
    return said.replace("String should match pattern", "a name that matches")


def _known(model: Any, where: tuple[str, ...]) -> list[str]:
    """Names of the options of the model at a place within another one."""
    for name in where:
        fields = _fields(model)
        model = fields.get(name, next(iter(fields.values()), None)) if fields else None
    return list(_fields(model))


def _fields(kind: Any) -> dict[str, Any]:
    """Name -> type of the options of a model, of one within a union, or of values by name."""
    if hasattr(kind, "model_fields"):
        return {field.alias or name: field.annotation for name, field in kind.model_fields.items()}
    parts = [part for part in get_args(kind) if hasattr(part, "model_fields") or get_args(part)]
    if getattr(kind, "__origin__", None) is dict:
        return {"*": get_args(kind)[1]}
    return next((found for part in parts if (found := _fields(part))), {})
