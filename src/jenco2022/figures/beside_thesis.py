from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.figures import panels
from puckbench.figures.axis_labels import CD_PLANE, HD_PLANE, axis_label
from puckbench.figures.binning import ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

_COLUMNS = (CD_PLANE, HD_PLANE)
_THESIS: dict[str, Any] = {"linewidth": 4.5, "alpha": 0.35, "solid_capstyle": "round"}


@FIGURES.register(
    "beside_thesis",
    title="The thesis's medians per compression rate beside ours",
    category="Findings",
)
def draw_beside_thesis(thesis_medians: pd.DataFrame, style: FigureStyle) -> Figure:
    """Medians at each compression rate of each codec (rows), in thesis figure 6.5 (wide lines) and
    in this run (thin lines with markers).

    For quartiles and numbers of clouds, see ``fig_6_5``. In the thesis, G-PCC truncates
    coordinates. On other data sets than the thesis's, curves of this run lie higher or lower, but
    have the same shape.
    """
    columns = ("thesis", "here")
    require_rows(thesis_medians, ("dataset", "codec", "rate", "quantity", *columns), "medians")
    require_numbers(thesis_medians, columns, "medians")
    looks = style.of_datasets(thesis_medians["dataset"])
    codecs, abreast = style.ordered_codecs(thesis_medians["codec"]), len(_COLUMNS)
    shape = len(codecs) * abreast, abreast
    figure, grid = panels.panel_grid(*shape, 1.5, style, sharey="col", sharex="row")
    for index, axes in enumerate(grid):
        codec, quantity = codecs[index // abreast], _COLUMNS[index % abreast]
        rows = thesis_medians[thesis_medians["quantity"] == quantity.name]
        values = rows[list(columns)].to_numpy(dtype=float).ravel()
        panels.set_log(axes, "y", panels.log_limits(values, quantity.name, style), minor=False)
        rows = rows[rows["codec"] == codec]
        rates = ordered_rates(rows["rate"])
        for dataset, look in looks.items():
            medians = rows[rows["dataset"] == dataset].set_index("rate").reindex(rates)
            thesis, here = (medians[name].to_numpy(dtype=float) for name in columns)
            x = np.arange(len(rates), dtype=float)
            axes.plot(x, thesis, color=look.colour, **_THESIS)
            panels.draw_line(axes, x, here, look)
        panels.label_rates([axes], rates, abreast)
        axes.set_ylabel(axis_label(quantity, 2))
        if index % abreast == 0:
            axes.set_title(style.of_codec(codec).title, loc="left", fontweight="bold", pad=3)
    figure.supxlabel("Compression rate of the codec", fontsize=style.font_size)
    handles = [
        panels.line_handle(look.title, color=look.colour, marker=look.marker)
        for look in looks.values()
    ]
    panels.add_fitting_legend(
        figure, [*handles, panels.line_handle("the thesis", **_THESIS)], style
    )
    return figure
