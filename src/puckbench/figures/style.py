from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from pointkit.models import Model, parsed
from puckbench.codecs.registry import Line
from puckbench.figures.plot_styles import (
    PlotStyle,
    codec_rank,
    codec_style,
    dataset_style,
    dataset_title,
)

COLUMN_WIDTH_IN = 3.5
PAGE_WIDTH_IN = 7.16
"""Widths of a column and of a page of an IEEE journal with two columns, in inches."""

Range = tuple[float, float]


Size = Annotated[float, Field(gt=0)]


class FigureStyle(Model):
    """Style of all figures, which a configuration may change.

    Parameters
    ----------
    font_size
        Size of axis labels, in points; tick labels are one point smaller.
    width_in
        Width of figures, in inches; by default, one or two columns of text, depending on the
        figure.
    dpi
        Resolution of pictures, in pixels per inch.
    line_width, marker_size
        Sizes in points.
    colours, markers, lines
        Changes to how codecs and error models are drawn, by name, as values of matplotlib.
    codec_titles, dataset_titles
        Titles in place of the default ones, by name.
    datasets
        Data sets whose panels come first, in this order.
    axis_ranges
        Limits (low, high) of logarithmic axes by table column, widened by decades to contain the
        data; by default, limits follow the data.
    """

    font_size: Size = 7.5
    width_in: Size | None = None
    dpi: Size = 300
    line_width: Size = 1.0
    marker_size: Size = 3.2
    colours: Mapping[str, str] = {}
    markers: Mapping[str, str] = {}
    lines: Mapping[str, Line] = {}
    codec_titles: Mapping[str, str] = {}
    dataset_titles: Mapping[str, str] = {}
    datasets: tuple[str, ...] = ()
    axis_ranges: Mapping[str, Range] = {}

    @model_validator(mode="after")
    def _check(self) -> Self:
        for column, (low, high) in self.axis_ranges.items():
            if not 0 < low < high:
                raise ValueError(f"axis_ranges: {column!r} must be [low, high] with 0 < low < high")
        if self.colours:
            from matplotlib.colors import is_color_like

            for name, colour in self.colours.items():
                if not is_color_like(colour):
                    raise ValueError(f"colours: {name!r}: {colour!r} is not a colour")
        if self.markers:
            from matplotlib.markers import MarkerStyle

            for name, marker in self.markers.items():
                if marker not in MarkerStyle.markers:
                    raise ValueError(f"markers: {name!r}: {marker!r} is not a marker")
        return self

    @classmethod
    def from_config(cls, *options: Mapping[str, Any]) -> FigureStyle:
        """Merge several sets of options to a style.

        Nested mappings are merged key by key. If options contradict each other, the last one
        counts.

        Parameters
        ----------
        options
            Mappings with the options of this class.

        Raises
        ------
        InputError
            A key is unknown or a value is not valid.
        """
        merged: dict[str, Any] = {}
        for key, value in (item for mapping in options for item in mapping.items()):
            inside = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
            merged[key] = {**merged[key], **value} if inside else value
        return parsed(cls, merged, "figure style")

    def of_codec(self, codec: str) -> PlotStyle:
        """Return how to draw a codec, with the changes that this style makes."""
        plot_style = codec_style(codec)
        return replace(
            plot_style,
            title=self.codec_titles.get(codec, plot_style.title),
            colour=self.colours.get(codec, plot_style.colour),
            marker=self.markers.get(codec, plot_style.marker),
            line=self.lines.get(codec, plot_style.line),
        )

    def title(self, dataset: str) -> str:
        """Return the title of a data set."""
        return self.dataset_titles.get(dataset, dataset_title(dataset))

    def of_datasets(self, datasets: Iterable[str]) -> dict[str, PlotStyle]:
        """Return how to draw each data set, by name, in the order of `ordered_datasets`.

        Colours follow the option `datasets`, so that they do not depend on which data sets are
        drawn.
        """
        places = list(dict.fromkeys((*self.datasets, *datasets)))
        return {
            name: dataset_style(places.index(name), self.title(name))
            for name in self.ordered_datasets(datasets)
        }

    def ordered_codecs(self, codecs: Iterable[str]) -> list[str]:
        """Return the names of codecs without repetitions, in the order of legends."""
        return sorted(set(codecs), key=codec_rank)

    def ordered_datasets(self, datasets: Iterable[str]) -> list[str]:
        """Return the names of data sets in the order of panels.

        Names are not repeated, and those in the option `datasets` come first.
        """
        present = list(dict.fromkeys(datasets))
        named = [name for name in self.datasets if name in present]
        return named + [name for name in present if name not in named]

    @contextmanager
    def context(self) -> Iterator[None]:
        """Apply this style to figures drawn in the `with` block.

        The user's matplotlibrc has no effect there.
        """
        import matplotlib.style

        with matplotlib.style.context(["default", self._parameters()]):
            yield

    def _parameters(self) -> dict[str, Any]:
        axes = ("xtick", "ytick")
        return {
            "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
            "mathtext.fontset": "dejavusans",
            "svg.hashsalt": "puckbench",  # the same element names in every file
            **dict.fromkeys(("pdf.fonttype", "ps.fonttype"), 42),
            **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), self.font_size),
            "legend.fontsize": self.font_size,
            "legend.frameon": False,
            **dict.fromkeys(("figure.dpi", "savefig.dpi"), self.dpi),
            **dict.fromkeys(("figure.constrained_layout.use", "axes.axisbelow", "axes.grid"), True),
            "lines.linewidth": self.line_width,
            "lines.markersize": self.marker_size,
            "axes.linewidth": 0.6,
            "grid.color": "#d9d9d9",
            "grid.linewidth": 0.4,
            **{f"{axis}.labelsize": self.font_size - 1 for axis in axes},
            **{f"{axis}.major.width": 0.6 for axis in axes},
            **{f"{axis}.minor.width": 0.4 for axis in axes},
            **{f"{axis}.major.size": 2.5 for axis in axes},
            **{f"{axis}.minor.size": 1.5 for axis in axes},
        }
