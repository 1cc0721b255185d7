from __future__ import annotations

import re
from collections.abc import Callable
from inspect import getdoc, signature
from typing import Any

_SECTION = re.compile(r"\n\n[A-Z][\w ]*\n-{3,}\n")


def typed_parameters(function: Callable[..., Any], *classes: str) -> dict[str, str]:
    """Return the parameters of a function that are annotated with one of some classes.

    Annotations are compared as text, so that no module is imported for them.

    Parameters
    ----------
    function
        The function.
    classes
        Names of classes, without modules.

    Returns
    -------
    dict[str, str]
        The class name of each such parameter, by the parameter's name.
    """
    parameters = signature(function).parameters
    names = {name: _class_name(parameter.annotation) for name, parameter in parameters.items()}
    return {name: class_name for name, class_name in names.items() if class_name in classes}


def optional_parameters(function: Callable[..., Any]) -> set[str]:
    """Return the names of the parameters of a function that have default values."""
    parameters = signature(function).parameters.items()
    return {name for name, parameter in parameters if parameter.default is not parameter.empty}


def caption_of(function: Callable[..., Any]) -> str:
    """Return the part of a function's docstring before the first section, as reStructuredText."""
    return _SECTION.split(getdoc(function) or "")[0]


def _class_name(annotation: Any) -> str:
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
    return text.split("|")[0].strip().rpartition(".")[2]
