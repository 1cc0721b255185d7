"""The style of all figures in one place: fonts, sizes, colours, titles, axis ranges."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field, field_validator

from puckbench.core.models import Model, parsed
from puckbench.figures.plot_styles import PlotStyle, codec_rank, codec_style, dataset_title

COLUMN_WIDTH_IN = 3.5
PAGE_WIDTH_IN = 7.16
"""Widths of one column and of the page in the two-column layout of IEEE journals, in inches."""

Range = tuple[float, float]


Size = Annotated[float, Field(gt=0)]


class FigureStyle(Model):
    """The style of a figure, of which a configuration may change any part.

    Parameters
    ----------
    font_size
        Points, of axis labels (ticks are one point smaller).
    width_in
        Inches; None for the figure's own (one column or the page).
    dpi
        Of PNG files and of images inside PDF files.
    line_width, marker_size
        Points.
    colours
        Codec or error model -> matplotlib colour.
    codec_titles, dataset_titles
        Name -> text.
    datasets
        Order of the panels (those not named follow).
    axis_ranges
        Table column -> (low, high), drawn at least; an axis is widened by whole decades when data
        fall outside, so that no point vanishes.
    """

    font_size: Size = 7.5
    width_in: Size | None = None
    dpi: Size = 300
    line_width: Size = 1.0
    marker_size: Size = 3.2
    colours: Mapping[str, str] = {}
    codec_titles: Mapping[str, str] = {}
    dataset_titles: Mapping[str, str] = {}
    datasets: tuple[str, ...] = ()
    axis_ranges: Mapping[str, Range] = {}

    @field_validator("axis_ranges")
    @classmethod
    def _check_ranges(cls, ranges: Mapping[str, Range]) -> Mapping[str, Range]:
        for column, (low, high) in ranges.items():
            if not 0 < low < high:
                raise ValueError(f"{column!r} must be [low, high] with 0 < low < high")
        return ranges

    @field_validator("colours")
    @classmethod
    def _check_colours(cls, colours: Mapping[str, str]) -> Mapping[str, str]:
        if colours:
            from matplotlib.colors import is_color_like

            for name, colour in colours.items():
                if not is_color_like(colour):
                    raise ValueError(f"{name!r}: {colour!r} is not a colour")
        return colours

    @classmethod
    def from_config(cls, *options: Mapping[str, Any]) -> FigureStyle:
        """Style of configuration mappings, a later one before an earlier one.

        Mappings inside (colours, titles, ranges) are merged key by key. InputError for an unknown
        key or a value that cannot be used.
        """
        merged: dict[str, Any] = {}
        for key, value in (item for mapping in options for item in mapping.items()):
            inside = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
            merged[key] = {**merged[key], **value} if inside else value
        return parsed(cls, merged, "figure style")

    def of_codec(self, codec: str) -> PlotStyle:
        """Title, colour, marker and line of a codec, the same in every figure."""
        plot_style = codec_style(codec)
        return replace(
            plot_style,
            title=self.codec_titles.get(codec, plot_style.title),
            colour=self.colours.get(codec, plot_style.colour),
        )

    def axis_range(self, column: str, default: Range) -> Range:
        """The least range of a column's axis: the style's, else `default`."""
        return self.axis_ranges.get(column, default)

    def title(self, dataset: str) -> str:
        """Panel title of a data set."""
        return self.dataset_titles.get(dataset, dataset_title(dataset))

    def ordered_codecs(self, codecs: Iterable[str]) -> list[str]:
        """Each codec once, in the order of the legend."""
        return sorted(set(codecs), key=codec_rank)

    def ordered_datasets(self, datasets: Iterable[str]) -> list[str]:
        """Each data set once: those named in the style first, the others as the table has them."""
        appearing = list(dict.fromkeys(datasets))
        named = [name for name in self.datasets if name in appearing]
        return named + [name for name in appearing if name not in named]

    @contextmanager
    def context(self) -> Iterator[None]:
        """Draw and save inside this: matplotlib's own defaults plus this style, nothing else.

        A user's matplotlibrc has no say, so the same table gives the same bytes everywhere.
        """
        import matplotlib.style

        with matplotlib.style.context(["default", self._parameters()]):
            yield

    def _parameters(self) -> dict[str, Any]:
        small = self.font_size - 1
        return {
            "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
            "mathtext.fontset": "dejavusans",
            "pdf.fonttype": 42,
            "ps.fonttype": 42,
            "font.size": self.font_size,
            "axes.titlesize": self.font_size,
            "axes.labelsize": self.font_size,
            "xtick.labelsize": small,
            "ytick.labelsize": small,
            "legend.fontsize": self.font_size,
            "figure.dpi": self.dpi,
            "savefig.dpi": self.dpi,
            "figure.constrained_layout.use": True,
            "lines.linewidth": self.line_width,
            "lines.markersize": self.marker_size,
            "axes.linewidth": 0.6,
            "axes.axisbelow": True,
            "axes.grid": True,
            "grid.color": "#d9d9d9",
            "grid.linewidth": 0.4,
            "xtick.major.width": 0.6,
            "ytick.major.width": 0.6,
            "xtick.minor.width": 0.4,
            "ytick.minor.width": 0.4,
            "xtick.major.size": 2.5,
            "ytick.major.size": 2.5,
            "xtick.minor.size": 1.5,
            "ytick.minor.size": 1.5,
            "legend.frameon": False,
        }
