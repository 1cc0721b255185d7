"""The look of all figures in one place: fonts, sizes, colours, titles, axis ranges."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from puckbench.core.errors import InputError
from puckbench.figures.plot_styles import Look, codec_look, codec_rank, dataset_title

COLUMN_WIDTH_IN = 3.5
PAGE_WIDTH_IN = 7.16
"""Widths of one column and of the page in the two-column layout of IEEE journals, in inches."""

Range = tuple[float, float]


@dataclass(frozen=True)
class FigureStyle:
    """Everything about a figure's look that a configuration may change.

    font_size: points, of axis labels (ticks are one point smaller). width_in: inches, None for
    the figure's own (one column or the page). dpi: of PNG files and of images inside PDF files.
    line_width, marker_size: points. colours: codec -> matplotlib colour. codec_titles,
    dataset_titles: name -> text. datasets: order of the panels (those not named follow).
    axis_ranges: table column -> (low, high), drawn at least; an axis is widened by whole decades
    when data fall outside, so that no point vanishes.
    """

    font_size: float = 7.5
    width_in: float | None = None
    dpi: int = 300
    line_width: float = 1.0
    marker_size: float = 3.2
    colours: Mapping[str, str] = field(default_factory=dict)
    codec_titles: Mapping[str, str] = field(default_factory=dict)
    dataset_titles: Mapping[str, str] = field(default_factory=dict)
    datasets: tuple[str, ...] = ()
    axis_ranges: Mapping[str, Sequence[float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """InputError for a value that cannot be used, naming it."""
        for name in _SIZES:
            _check_size(name, getattr(self, name))
        for column, limits in self.axis_ranges.items():
            _check_range(column, limits)
        if self.colours:
            _check_colours(self.colours)

    @classmethod
    def from_config(cls, *options: Mapping[str, Any]) -> FigureStyle:
        """Style of configuration mappings, a later one before an earlier one.

        Mappings inside (colours, titles, ranges) are merged key by key. InputError for an unknown
        key or a value that cannot be used.
        """
        merged: dict[str, Any] = {}
        for key, value in (item for mapping in options for item in mapping.items()):
            if key not in cls.__dataclass_fields__:
                known = ", ".join(cls.__dataclass_fields__)
                raise InputError(f"figure style: unknown key {key!r} (known: {known})")
            merged[key] = _merged(key, merged.get(key, {}), value)
        if "datasets" in merged:
            merged["datasets"] = tuple(merged["datasets"])
        return cls(**merged)

    def look(self, codec: str) -> Look:
        """Title, colour, marker and line of a codec, the same in every figure."""
        look = codec_look(codec)
        return replace(
            look,
            title=self.codec_titles.get(codec, look.title),
            colour=self.colours.get(codec, look.colour),
        )

    def axis_range(self, column: str, default: Range) -> Range:
        """The least range of a column's axis: the style's, else `default`."""
        low, high = self.axis_ranges.get(column, default)
        return low, high

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


_SIZES = ("font_size", "width_in", "dpi", "line_width", "marker_size")
_MAPPINGS = ("colours", "codec_titles", "dataset_titles", "axis_ranges")


def _merged(key: str, before: Mapping[str, Any], value: Any) -> Any:
    """`value`, laid over `before` when the key holds a mapping."""
    if key not in _MAPPINGS:
        return value
    if not isinstance(value, Mapping):
        raise InputError(f"figure style: {key} must be a mapping, not {value!r}")
    return {**before, **value}


def _check_size(name: str, value: Any) -> None:
    if value is None and name == "width_in":
        return
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"figure style: {name} must be a number, not {value!r}")
    if not 0 < value < float("inf"):
        raise InputError(f"figure style: {name} must be positive, not {value!r}")


def _check_range(column: str, limits: Any) -> None:
    numbers = isinstance(limits, Sequence) and all(isinstance(v, int | float) for v in limits)
    if not numbers or len(limits) != 2 or not 0 < limits[0] < limits[1]:
        raise InputError(
            f"figure style: axis_ranges of {column!r} must be [low, high] with 0 < low < high, "
            f"not {limits!r}"
        )


def _check_colours(colours: Mapping[str, Any]) -> None:
    from matplotlib.colors import is_color_like

    for codec, colour in colours.items():
        if not is_color_like(colour):
            raise InputError(f"figure style: colours of {codec!r}: {colour!r} is not a colour")
