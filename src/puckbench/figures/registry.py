"""The registry of figures.

A figure is a function, whose docstring is the caption::

    @FIGURES.register("point_counts", title="Point counts", category="Clouds")
    def draw_point_counts(clouds: pd.DataFrame, style: FigureStyle) -> Figure:
        \"\"\"Number of points per cloud in each data set.\"\"\"

Parameters besides ``style`` are inputs: a DataFrame is the table of that name, a PointCloud is an
example cloud (``example_object``, ``example_raw``, ``example_clean``, ``example_noisy``). Import
matplotlib and pandas inside functions, since planning imports modules of figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pointkit.geometry.cloud import CoordinateFrame
from pointkit.registry import Registry
from puckbench.core.introspection import caption_of, typed_parameters

SPINS = "spins"
"""Requirement: virtual scans by a level, static sensor, with their true surfaces."""


def at(distance_m: float) -> str:
    return f"{distance_m:g} m"


@dataclass(frozen=True)
class FigureEntry:
    """A registered figure.

    Parameters
    ----------
    draw
        Function that returns a matplotlib Figure from inputs and ``style``, passed by keyword.
    title, category
        Heading and group in the report.
    number
        Number in a publication, for sorting, or empty.
    instead_of
        Name of another figure whose picture this one shows under its own name and number, or
        empty. A run draws this figure and not the other, which can still be asked for.
    remark
        Text that follows the docstring of `draw` in the caption.
    is_first_look
        Whether a run draws the figure of the first codec's results while other codecs run.
    needs
        Further requirements on a plan: names of registered needs, or distances (`at`) and error
        models of the sensor study.
    frame
        Coordinate frame of the drawn clouds.
    """

    name: str
    draw: Callable[..., Any]
    title: str = ""
    category: str = "Further figures"
    number: str = ""
    instead_of: str = ""
    remark: str = ""
    is_first_look: bool = False
    needs: tuple[str, ...] = ()
    frame: CoordinateFrame = "scaled"

    @property
    def kinds(self) -> Mapping[str, str]:
        return typed_parameters(self.draw, "DataFrame", "PointCloud")

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(self.kinds)

    @property
    def sort_key(self) -> list[float]:
        """Key for sorting by integers, so that 5.2 precedes 5.10."""
        return [float(part) for part in self.number.split(".")] if self.number else [math.inf]

    @property
    def caption(self) -> str:
        return f"{caption_of(self.draw)}\n\n{self.remark}".strip()


FIGURES: Registry[FigureEntry] = Registry("figure", "figures", make=FigureEntry)


def figure_entry(name: str) -> FigureEntry:
    """Return a figure by name or ``path/to/file.py:function``, or raise InputError."""
    return FIGURES.get(name)


def figure_entries() -> dict[str, FigureEntry]:
    """Return all figures by name, numbered figures first."""
    entries = {name: FIGURES.get(name) for name in FIGURES.names()}
    return dict(sorted(entries.items(), key=lambda item: item[1].sort_key))
