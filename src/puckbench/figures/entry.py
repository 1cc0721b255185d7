"""What the list of figures says of each: what draws it, from which inputs, and when it can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

STUDY = "sensor_study"
"""Needed of a configuration: the measurements of chapter 5."""


BOTH_GPCC = "gpcc"
"""Needed of a configuration: G-PCC with coordinates rounded and with coordinates truncated."""


def at(distance_m: float) -> str:
    """Needed of a configuration: scans of its sensor study from this distance."""
    return f"{distance_m:g} m"


@dataclass(frozen=True)
class FigureEntry:
    """One figure: a dotted "module:function", its inputs' names, and how the report lists it.

    The function takes every input as a keyword argument of that name (a table of
    `registry.TABLES` as a pandas DataFrame, an example of `registry.EXAMPLES` as a PointCloud) and
    ``style``, and returns a matplotlib Figure. needs: what a configuration must have besides for
    the figure to be drawn: `STUDY`, scans `at` a distance, or the name of an error model.
    """

    function: str
    inputs: tuple[str, ...]
    title: str
    category: str
    thesis: str = ""
    needs: tuple[str, ...] = ()

    def load(self) -> Callable[..., Any]:
        """The drawing function itself, imported now."""
        module, name = self.function.split(":")
        function: Callable[..., Any] = getattr(import_module(module), name)
        return function
