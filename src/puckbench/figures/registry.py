"""The figures: how one is registered, and what each is drawn from.

A figure is one function with its registration above it; its docstring is the caption::

    @FIGURES.register("fig_6_4", title="Point counts", category="Clouds", thesis="6.4")
    def draw_point_counts(clouds: pd.DataFrame, style: FigureStyle) -> Figure:
        \"\"\"Number of points per cloud in each data set (thesis figure 6.4).\"\"\"

Its parameters beside ``style`` name its inputs: a DataFrame is the table of that name, a PointCloud
an example cloud (``example_object``, ``example_raw``, ``example_clean``, ``example_noisy``).
Planning imports the modules of all figures: these import matplotlib and pandas in functions only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from puckbench.core.registry import Registry
from puckbench.core.signatures import annotated, caption_of
from puckbench.geometry.cloud import CoordinateFrame

SPINS = "spins"
"""What a figure may need of a configuration: virtual spins, level and still, with their truth."""


def at(distance_m: float) -> str:
    """Needed of a configuration: scans of its sensor study from this distance."""
    return f"{distance_m:g} m"


@dataclass(frozen=True)
class FigureEntry:
    """A registered figure.

    Parameters
    ----------
    name
        Of its files and of its job.
    draw
        Takes each input and ``style`` by keyword and returns a matplotlib Figure.
    title, category
        How the report lists it.
    thesis
        Number of the thesis's figure, which orders the report; empty for others.
    needs
        What a configuration must have beside the inputs: as for a table, `SPINS`,
        scans `at` a distance, or the name of an error model of its sensor study.
    frame
        Of the clouds whose results it draws; rows of others are left out.
    """

    name: str
    draw: Callable[..., Any]
    title: str = ""
    category: str = "Further figures"
    thesis: str = ""
    needs: tuple[str, ...] = ()
    frame: CoordinateFrame = "scaled"

    @property
    def kinds(self) -> Mapping[str, str]:
        """Inputs, and whether each is a DataFrame or a PointCloud."""
        return annotated(self.draw, "DataFrame", "PointCloud")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the tables and clouds that the figure is drawn from."""
        return tuple(self.kinds)

    @property
    def place(self) -> list[float]:
        """The thesis's number in parts, by which figures are ordered: 5.2 comes before 5.10."""
        return [float(part) for part in self.thesis.split(".")] if self.thesis else [math.inf]

    @property
    def caption(self) -> str:
        """What the report says below the figure, in reStructuredText."""
        return caption_of(self.draw)


FIGURES: Registry[FigureEntry] = Registry("figure", "figures", make=FigureEntry)


def figure_entry(name: str) -> FigureEntry:
    """Look up a figure.

    Parameters
    ----------
    name
        Of a registered figure, or ``path/to/file.py:function``.

    Raises
    ------
    InputError
        There is none.
    """
    return FIGURES.get(name)


def figure_entries() -> dict[str, FigureEntry]:
    """All figures by name: those of the thesis by their numbers, then the others."""
    entries = {name: FIGURES.get(name) for name in FIGURES.names()}
    return dict(sorted(entries.items(), key=lambda item: item[1].place))
