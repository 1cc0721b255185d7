from __future__ import annotations

from typing import TYPE_CHECKING, Any

from puckbench.figures.axis_labels import CD_PLANE, axis_label
from puckbench.figures.binning import ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    add_fitting_legend,
    label_outer,
    line_handle,
    log_limits,
    panel_grid,
    panels_abreast,
    set_log,
    set_title,
    titled,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_KEYS = ("dataset", "cloud")
_POINTS: dict[str, Any] = {"linestyle": "", "markerfacecolor": "none", "markeredgewidth": 0.8}


@FIGURES.register(
    "elongation", title="Chamfer distance against the elongation of the cloud", category="Findings"
)
def draw_elongation(metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Chamfer distance (point-to-plane) at each codec's middle rate, against the elongation of the
    cloud.

    The elongation is the shortest side of the bounding box divided by the longest. A marker stands
    for one of n clouds. Distances of zero (lossless) are not drawn.
    """
    numbers = ("elongation", CD_PLANE.name)
    require_rows(metrics, (*_KEYS, "codec", "rate", numbers[1]), "metrics")
    require_rows(clouds, (*_KEYS, numbers[0]), "clouds")
    columns = metrics[[*_KEYS, "codec", "rate", numbers[1]]]
    rows = _middle_rates(columns).merge(clouds[[*_KEYS, numbers[0]]], on=list(_KEYS))
    require_numbers(rows, numbers, "metrics and clouds")
    datasets = style.ordered_datasets(rows["dataset"])
    abreast = panels_abreast(len(datasets))
    figure, panels = panel_grid(len(datasets), abreast, 2.1, style)
    limits = log_limits(rows[CD_PLANE.name].to_numpy(dtype=float), CD_PLANE.name, style)
    low, high = rows["elongation"].min(), rows["elongation"].max()
    margin = 0.05 * (high - low) or 0.05
    for axes, dataset in zip(panels, datasets, strict=True):
        set_log(axes, "y", limits, minor=False)
        axes.set_xlim(low - margin, high + margin)
        of_dataset = rows[rows["dataset"] == dataset]
        set_title(axes, titled(style.title(dataset), of_dataset), abreast, style)
        for codec in style.ordered_codecs(of_dataset["codec"]):
            is_drawn = (of_dataset["codec"] == codec) & (of_dataset[CD_PLANE.name] > 0)
            x, y = (of_dataset.loc[is_drawn, name] for name in (numbers[0], CD_PLANE.name))
            look = style.of_codec(codec)
            axes.plot(x, y, color=look.colour, marker=look.marker, **_POINTS)
    label_outer(panels, abreast, "Elongation, shortest over longest side", axis_label(CD_PLANE, 2))
    looks = map(style.of_codec, style.ordered_codecs(rows["codec"]))
    handles = [line_handle(k.title, color=k.colour, marker=k.marker, **_POINTS) for k in looks]
    add_fitting_legend(figure, handles, style)
    return figure


def _middle_rates(metrics: pd.DataFrame) -> pd.DataFrame:
    rates = {codec: ordered_rates(set(part["rate"])) for codec, part in metrics.groupby("codec")}
    middle = {codec: names[(len(names) - 1) // 2] for codec, names in rates.items()}
    return metrics[metrics["rate"] == metrics["codec"].map(middle)]
