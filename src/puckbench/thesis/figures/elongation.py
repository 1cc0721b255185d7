from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.figures.binning import ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    add_legend,
    fitted_limits,
    label_outer,
    panel_grid,
    panels_abreast,
    set_log,
    set_title,
    titled,
)
from puckbench.figures.plotted_metrics import CD_PLANE
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_KEYS = ("dataset", "cloud")
_MOST_JOINED = 12
_CD = CD_PLANE.within(1e-1, 1e2)


@FIGURES.register(
    "elongation", title="Chamfer distance against the elongation of the cloud", category="Findings"
)
def draw_elongation(metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Chamfer distance (point-to-plane) at each codec's middle rate, against a cloud's elongation.

    Markers: n clouds, joined by lines if n is at most 12. Elongation: shortest over longest side of
    the bounding box. The thesis reports no visible effect of a room's elongation, without a figure.
    Zeros (lossless) are not drawn.
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
    limits = style.axis_ranges.get(_CD.column) or fitted_limits(values, _CD.limits)
    low, high = rows["elongation"].min(), rows["elongation"].max()
    margin = 0.05 * (high - low) or 0.05
    for axes, dataset in zip(panels, datasets, strict=True):
        set_log(axes, "y", limits, minor=False)
        axes.set_xlim(low - margin, high + margin)
        of_dataset = rows[rows["dataset"] == dataset]
        set_title(axes, titled(style.title(dataset), of_dataset), abreast, style)
        is_joined = of_dataset["cloud"].nunique() <= _MOST_JOINED
        for codec in style.ordered_codecs(of_dataset["codec"]):
            codec_rows = of_dataset[of_dataset["codec"] == codec].sort_values("elongation")
            codec_rows, shown = codec_rows[codec_rows[CD_PLANE.column] > 0], style.of_codec(codec)
            axes.plot(
                codec_rows["elongation"], codec_rows[CD_PLANE.column],
                color=shown.colour, marker=shown.marker, linestyle=shown.line if is_joined else "",
                linewidth=0.6, markerfacecolor="none", markeredgewidth=0.8,
            )  # fmt: skip
    label_outer(panels, abreast, "Elongation, shortest over longest side", CD_PLANE.short_label)
    add_legend(figure, style.ordered_codecs(rows["codec"]), style)
    return figure


def _middle_rates(metrics: pd.DataFrame) -> pd.DataFrame:
    rates = {codec: ordered_rates(set(part["rate"])) for codec, part in metrics.groupby("codec")}
    middle = {codec: names[(len(names) - 1) // 2] for codec, names in rates.items()}
    return metrics[metrics["rate"] == metrics["codec"].map(middle)]
