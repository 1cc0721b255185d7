"""What a registered function says of itself: the inputs that it takes, and its text for readers."""

from __future__ import annotations

import re
from collections.abc import Callable
from inspect import getdoc, signature
from typing import Any

_SECTION = re.compile(r"\n\n[A-Z][\w ]*\n-{3,}\n")


def annotated(function: Callable[..., Any], *classes: str) -> dict[str, str]:
    """Parameters of a function that are annotated as one of some classes, with the class of each.

    Parameters
    ----------
    function
        Any function; its annotations may be strings and are not evaluated.
    classes
        Names of classes without their modules, such as ``DataFrame``.
    """
    parameters = signature(function).parameters
    written = {name: _written(parameter.annotation) for name, parameter in parameters.items()}
    return {name: kind for name, kind in written.items() if kind in classes}


def defaulted(function: Callable[..., Any]) -> set[str]:
    """Parameters of a function that may be left out."""
    parameters = signature(function).parameters.items()
    return {name for name, parameter in parameters if parameter.default is not parameter.empty}


def caption_of(function: Callable[..., Any]) -> str:
    """The docstring of a function up to its first section, in reStructuredText."""
    return _SECTION.split(getdoc(function) or "")[0]


def _written(annotation: Any) -> str:
    """The class of an annotation by its bare name; of ``X | None`` that of X."""
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
    return text.split("|")[0].strip().rpartition(".")[2]
