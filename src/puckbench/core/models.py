"""Options and configuration as pydantic models, whose errors are one clear line each."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from puckbench.core.errors import InputError

M = TypeVar("M", bound=BaseModel)


class Model(BaseModel):
    """A frozen record of options: unknown names are refused, words are never read as numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def parsed(model: type[M], values: Any, what: str) -> M:
    """Make a model from loose values, as a configuration or a command line gives them.

    Parameters
    ----------
    model
        The class of the options.
    values
        Names and values; lists stand for tuples, whole numbers for any numbers.
    what
        What the values are for, which begins the line of an error.

    Raises
    ------
    InputError
        The first fault in one line: the key, its value, and what is allowed.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{what} is {values!r}, but must be options by name")
    try:
        return model.model_validate(_immutable(dict(values)))
    except ValidationError as error:
        raise InputError(f"{what}: {_one_line(error, model)}") from error


def closest(name: str, known: list[str]) -> str:
    """ "; did you mean 'x'?" where a known name is near to the unknown one, else nothing."""
    near = get_close_matches(name, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def _immutable(value: Any) -> Any:
    """Lists as tuples, at every depth: strict models take no list for a tuple."""
    if isinstance(value, Mapping):
        return {name: _immutable(item) for name, item in value.items()}
    return tuple(map(_immutable, value)) if isinstance(value, list) else value


def _one_line(error: ValidationError, model: type[BaseModel]) -> str:
    first = error.errors()[0]
    where = [str(part) for part in first["loc"] if not _is_branch(part)]
    name = ".".join(where)
    kind, value, context = first["type"], first["input"], first.get("ctx", {})
    if kind == "extra_forbidden":
        known = _known(model, where[:-1])
        listed = f" (known: {', '.join(known)})" if known else ""
        return f"unknown option '{name}'{listed}{closest(where[-1], known)}"
    if kind == "missing":
        return f"the option '{name}' is missing"
    if kind == "value_error":
        return f"{name}: {context['error']}" if name else str(context["error"])
    if kind in {"literal_error", "enum"}:
        return f"'{name}' is {value!r} (allowed: {context['expected']})"
    said = first["msg"].removeprefix("Input should be ")
    return f"'{name}' is {value!r}, but must be {said}"


def _is_branch(part: Any) -> bool:
    """Whether a part of a place names a branch of a union, which is no key of the input."""
    return isinstance(part, str) and not part.isidentifier() and "[" in part


def _known(model: Any, where: list[str]) -> list[str]:
    """Names of the options of the model at a place within another one."""
    for name in where:
        fields = getattr(model, "model_fields", {})
        if name not in fields:
            return []
        model = fields[name].annotation
    return list(getattr(model, "model_fields", {}))
