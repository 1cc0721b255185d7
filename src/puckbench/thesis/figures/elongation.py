from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from puckbench.figures.binning import ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    add_legend,
    label_outer,
    log_limits,
    panel_grid,
    panels_abreast,
    set_log,
    set_title,
)
from puckbench.figures.plotted_metrics import CD_PLANE
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_KEYS = ("dataset", "cloud")
_CD = CD_PLANE.within(1e-1, 1e2)


@FIGURES.register(
    "elongation", title="Chamfer distance against the elongation of the cloud", category="Findings"
)
def draw_elongation(metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Chamfer distance (point-to-plane) at each codec's middle rate, against a cloud's elongation.

    Elongation: shortest over longest side of the bounding box. The thesis reports no visible effect
    of a room's elongation, without a figure.
    """
    numbers = ("elongation", CD_PLANE.column)
    require_rows(metrics, (*_KEYS, "codec", "rate", numbers[1]), "metrics")
    require_rows(clouds, (*_KEYS, numbers[0]), "clouds")
    columns = metrics[[*_KEYS, "codec", "rate", numbers[1]]]
    rows = _middle_rates(columns).merge(clouds[[*_KEYS, numbers[0]]], on=list(_KEYS))
    require_numbers(rows, numbers, "metrics and clouds")
    datasets = style.ordered_datasets(rows["dataset"])
    abreast = panels_abreast(len(datasets))
    figure, panels = panel_grid(len(datasets), abreast, 2.1, style)
    values = rows[CD_PLANE.column].to_numpy(dtype=float)
    limits = log_limits(values, style.axis_range(_CD.column, _CD.limits))
    for axes, dataset in zip(panels, datasets, strict=True):
        set_log(axes, "y", limits, minor=False)
        axes.set_xlim(0, 1)
        set_title(axes, style.title(dataset), abreast, style)
        for codec in style.ordered_codecs(rows["codec"]):
            own = rows[(rows["dataset"] == dataset) & (rows["codec"] == codec)]
            shown = style.of_codec(codec)
            x, y = (own[name].to_numpy(dtype=float) for name in numbers)
            axes.plot(x, np.maximum(y, limits[0]), shown.marker, color=shown.colour, alpha=0.6)
    label_outer(panels, abreast, "Elongation, shortest over longest side", CD_PLANE.short_label)
    add_legend(figure, style.ordered_codecs(rows["codec"]), style)
    return figure


def _middle_rates(metrics: pd.DataFrame) -> pd.DataFrame:
    rates = {codec: ordered_rates(set(part["rate"])) for codec, part in metrics.groupby("codec")}
    middle = {codec: names[(len(names) - 1) // 2] for codec, names in rates.items()}
    return metrics[metrics["rate"] == metrics["codec"].map(middle)]
