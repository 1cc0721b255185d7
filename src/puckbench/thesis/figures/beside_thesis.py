from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from puckbench.figures import panels
from puckbench.figures.binning import Curve, ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.plotted_metrics import CD_PLANE, HD_PLANE
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROWS = (CD_PLANE.within(1e-2, 1e3), HD_PLANE.within(1e-1, 1e4))
_WIDE, _FAINT = 4.5, 0.35
"""Width in points and opacity of the thesis's lines."""


@FIGURES.register(
    "beside_thesis",
    title="The thesis's medians per compression rate beside ours",
    category="Findings",
)
def draw_beside_thesis(thesis_medians: pd.DataFrame, style: FigureStyle) -> Figure:
    """Medians per compression rate in thesis figure 6.5 (wide lines) and in this run (thin lines).

    For quartiles and numbers of clouds, see ``fig_6_5``. In the thesis, G-PCC truncates
    coordinates. On other data sets than the thesis's, curves of this run lie higher or lower, but
    have the same shape.
    """
    columns = ("thesis", "here")
    require_rows(thesis_medians, ("dataset", "codec", "rate", "quantity", *columns), "medians")
    require_numbers(thesis_medians, columns, "medians")
    datasets = style.ordered_datasets(thesis_medians["dataset"])
    abreast = len(datasets)
    figure, grid = panels.panel_grid(len(_ROWS) * abreast, abreast, 1.9, style, sharey="row")
    rates = ordered_rates(set(thesis_medians["rate"]))
    for index, axes in enumerate(grid):
        quantity, dataset = _ROWS[index // abreast], datasets[index % abreast]
        rows = thesis_medians[thesis_medians["quantity"] == quantity.column]
        values = rows[list(columns)].to_numpy(dtype=float).ravel()
        limits = panels.log_limits(values, style.axis_range(quantity.column, quantity.limits))
        panels.set_log(axes, "y", limits, minor=False)
        _draw_panel(axes, rows[rows["dataset"] == dataset], rates, style)
        if index < abreast:
            panels.set_title(axes, style.title(dataset), abreast, style)
        if index % abreast == 0:
            axes.set_ylabel(quantity.short_label)
    panels.label_rates(grid, rates, abreast)
    figure.supxlabel("Compression rate (wide lines: the thesis)", fontsize=style.font_size)
    panels.add_legend(figure, style.ordered_codecs(thesis_medians["codec"]), style)
    return figure


def _draw_panel(axes: Axes, rows: pd.DataFrame, rates: list[str], style: FigureStyle) -> None:
    for codec in style.ordered_codecs(rows["codec"]):
        codec_rows = rows[rows["codec"] == codec].set_index("rate").reindex(rates)
        thesis, here = (
            codec_rows["thesis"].to_numpy(dtype=float),
            codec_rows["here"].to_numpy(dtype=float),
        )
        x = np.arange(len(rates), dtype=float)
        colour = style.of_codec(codec).colour
        axes.plot(x, thesis, color=colour, linewidth=_WIDE, alpha=_FAINT, solid_capstyle="round")
        panels.draw_over_rates(axes, Curve(x, here, here, here), style.of_codec(codec))
