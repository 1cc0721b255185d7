"""The registry of figures.

A figure is a function that draws, and whose docstring is the caption::

    @FIGURES.register("point_counts", title="Point counts", category="Clouds")
    def draw_point_counts(clouds: pd.DataFrame, style: FigureStyle) -> Figure:
        \"\"\"Number of points per cloud in each data set.\"\"\"

Parameters besides ``style`` are inputs. A parameter of type DataFrame gets the table of that name;
one of type PointCloud gets an example cloud (``example_object``, ``example_raw``,
``example_clean``, ``example_noisy``). Import matplotlib and pandas inside functions, because
modules of figures are imported before anything is drawn.
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
"""Requirement of a figure: virtual scans by a level sensor at rest, with their true surfaces."""


def at(distance_m: float) -> str:
    """Return the requirement that the sensor study has scans from this distance."""
    return f"{distance_m:g} m"


@dataclass(frozen=True)
class FigureEntry:
    """A registered figure: the function that draws it, and how the report shows it.

    Parameters
    ----------
    name
        Name of the figure.
    draw
        Function that returns a matplotlib Figure. It gets its inputs and ``style`` by keyword.
    title, category
        Heading of the figure, and heading of its group, in the report.
    number
        Number in a publication, by which figures are sorted, or empty.
    instead_of
        Name of another figure whose picture this one shows under its own name and number, or empty.
        A run draws this figure and not the other, which can still be asked for.
    remark
        Text that follows the docstring of `draw` in the caption.
    is_first_look
        Whether a run draws the figure of the first codec's results while other codecs run.
    needs
        What a run must have for this figure: names of registered requirements, or distances (`at`)
        and error models of the sensor study.
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
        """Types of the inputs, ``DataFrame`` or ``PointCloud``, by name of the input."""
        return typed_parameters(self.draw, "DataFrame", "PointCloud")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(self.kinds)

    @property
    def sort_key(self) -> list[float]:
        """Key that sorts figures in the order of their numbers, so that 5.2 precedes 5.10."""
        return [float(part) for part in self.number.split(".")] if self.number else [math.inf]

    @property
    def caption(self) -> str:
        """Caption in reStructuredText: the docstring of `draw`, followed by the remark."""
        return f"{caption_of(self.draw)}\n\n{self.remark}".strip()


FIGURES: Registry[FigureEntry] = Registry("figure", "figures", make=FigureEntry)


def figure_entry(name: str) -> FigureEntry:
    """Return a figure by its name or ``path/to/file.py:function``.

    Raises InputError if there is no such figure.
    """
    return FIGURES.get(name)


def figure_entries() -> dict[str, FigureEntry]:
    """Return all registered figures by name, numbered figures first."""
    entries = {name: FIGURES.get(name) for name in FIGURES.names()}
    return dict(sorted(entries.items(), key=lambda item: item[1].sort_key))
