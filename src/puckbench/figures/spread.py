"""How a distortion varies over the clouds of a data set: boxes per codec and rate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.figures.binning import ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import log_limits, panel_grid, set_log, set_title
from puckbench.figures.quantities import CD_PLANE
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle, Range

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
_QUANTITY = CD_PLANE.within(1e-2, 1e3)


@FIGURES.register(
    "spread",
    title="Spread of the Chamfer distance over clouds, per codec and rate",
    category="Results per rate",
)
def draw_spread(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Spread of the Chamfer distance (point-to-plane) over clouds: one row per codec, one
    column per data set, a box for each rate from the first to the third quartile with the
    median, and whiskers from 5 to 95 %.

    On a logarithmic axis boxes of equal height are equal factors. Values of zero (lossless) stand
    on the lower edge. The thesis draws medians alone.
    """
    require_rows(metrics, ("dataset", "codec", "rate", _QUANTITY.column), "metrics")
    require_numbers(metrics, (_QUANTITY.column,), "metrics")
    datasets = style.ordered_datasets(metrics["dataset"])
    codecs = style.ordered_codecs(metrics["codec"])
    rates = ordered_rates(set(metrics["rate"]))
    shares = _shares(metrics)
    limits = log_limits(shares.to_numpy().ravel(), style.axis_range("cd_plane", _QUANTITY.limits))
    figure, panels = panel_grid(len(codecs) * len(datasets), len(datasets), 1.25, style)
    for index, axes in enumerate(panels):
        codec, dataset = codecs[index // len(datasets)], datasets[index % len(datasets)]
        set_log(axes, "y", limits, minor=False)
        shown = style.of_codec(codec)
        _draw_boxes(axes, _panel(shares, dataset, codec, rates), limits, shown.colour)
        if index < len(datasets):
            set_title(axes, style.title(dataset), len(datasets), style)
        if index % len(datasets) == 0:
            _name_codec(axes, shown.title, style)
    _label(figure, panels, rates, len(datasets), style)
    return figure


def _shares(metrics: pd.DataFrame) -> pd.DataFrame:
    """Quantiles over clouds, one column each, by data set, codec and rate."""
    groups = metrics.dropna(subset=["cd_plane"]).groupby(["dataset", "codec", "rate"])
    return groups["cd_plane"].quantile(np.array(_SHARES)).unstack()


def _panel(shares: pd.DataFrame, dataset: str, codec: str, rates: list[str]) -> pd.DataFrame:
    """The quantiles (rates, 5) of one panel, nan where there is no value."""
    import pandas as pd

    rows = pd.MultiIndex.from_product([[dataset], [codec], rates])
    return shares.reindex(rows).reset_index(drop=True)


def _draw_boxes(axes: Axes, quantiles: pd.DataFrame, limits: Range, colour: str) -> None:
    keys = ("whislo", "q1", "med", "q3", "whishi")
    known = quantiles.dropna().clip(lower=limits[0])
    boxes: list[dict[str, Any]] = [
        dict(zip(keys, row, strict=True)) for row in known.itertuples(index=False)
    ]
    if not boxes:
        axes.text(0.5, 0.5, "no values", transform=axes.transAxes, ha="center", va="center")
        return
    line = {"color": colour, "linewidth": 0.8}
    axes.bxp(
        boxes,
        positions=known.index.to_numpy(dtype=float),
        widths=0.6,
        showfliers=False,
        patch_artist=True,
        boxprops={"facecolor": colour, "edgecolor": colour, "alpha": 0.45, "linewidth": 0.8},
        medianprops={"color": "#000000", "linewidth": 1.0},
        whiskerprops=line,
        capprops=line,
        manage_ticks=False,
    )


def _name_codec(axes: Axes, title: str, style: FigureStyle) -> None:
    axes.annotate(
        title, (0.97, 0.95), xycoords="axes fraction", ha="right", va="top", size=style.font_size
    )


def _label(
    figure: Figure, panels: list[Axes], rates: list[str], abreast: int, style: FigureStyle
) -> None:
    step = 2 if len(rates) * abreast > 44 else 1
    for axes in panels:
        axes.set_xlim(-0.6, len(rates) - 0.4)
        axes.set_xticks(np.arange(0, len(rates), step), rates[::step])
    for axes in panels[::abreast]:
        axes.set_ylabel(_QUANTITY.short_label)
    figure.supxlabel("Compression rate", fontsize=style.font_size)
