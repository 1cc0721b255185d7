from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from puckbench.figures.binning import Curve, medians_per_rate, ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    add_legend,
    draw_over_rates,
    label_rates,
    log_limits,
    panel_grid,
    set_log,
    set_title,
    titled,
    unranked_handle,
)
from puckbench.figures.plotted_metrics import (
    CD_PLANE,
    DECODE_TIME,
    ENCODE_TIME,
    HD_PLANE,
    PlottedMetric,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.metrics.timing import unranked_codecs

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROWS = (CD_PLANE.within(1e-2, 1e4), HD_PLANE.within(1e-2, 1e4), ENCODE_TIME, DECODE_TIME)


@FIGURES.register(
    "fig_6_5", title="Medians per compression rate", category="Results per rate", number="6.5"
)
def draw_medians_per_rate(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Medians over clouds at each compression rate, in order of bits (thesis figure 6.5).

    Chamfer and squared Hausdorff distance (point-to-plane, squared grid units), encoding and
    decoding time in seconds. Bars: quartiles. n: clouds. Ticks at the lower edge: lossless rates.
    Unlike in the thesis, times exclude the start of a process.
    """
    columns = tuple(quantity.column for quantity in _ROWS)
    require_rows(metrics, ("dataset", "cloud", "codec", "rate", *columns), "metrics")
    require_numbers(metrics, columns, "metrics")
    datasets = style.ordered_datasets(metrics["dataset"])
    abreast = len(datasets)
    figure, panels = panel_grid(len(_ROWS) * abreast, abreast, 1.5, style, sharey="row")
    for index, quantity in enumerate(_ROWS):
        row = panels[index * abreast : (index + 1) * abreast]
        _draw_row(dict(zip(datasets, row, strict=True)), metrics, quantity, style)
    for axes, dataset in zip(panels[:abreast], datasets, strict=True):
        rows = metrics[metrics["dataset"] == dataset]
        set_title(axes, titled(style.title(dataset), rows), abreast, style)
    label_rates(panels, ordered_rates(set(metrics["rate"])), abreast)
    figure.supxlabel("Compression rate", fontsize=style.font_size)
    extra_handles = [unranked_handle()] if unranked_codecs(metrics) else []
    add_legend(figure, style.ordered_codecs(metrics["codec"]), style, extra_handles)
    return figure


def _draw_row(
    row: dict[str, Axes], metrics: pd.DataFrame, quantity: PlottedMetric, style: FigureStyle
) -> None:
    medians = medians_per_rate(metrics, quantity.column)
    rates = ordered_rates(set(metrics["rate"]))
    default = style.axis_range(quantity.column, quantity.limits)
    limits = log_limits(medians[quantity.column].to_numpy(dtype=float), default)
    for dataset, axes in row.items():
        set_log(axes, "y", limits, minor=False)
        dataset_metrics = metrics[metrics["dataset"] == dataset]
        part = medians[medians["dataset"] == dataset]
        for codec in style.ordered_codecs(part["codec"]):
            codec_rows = part[part["codec"] == codec].set_index("rate").reindex(rates)
            y, low, high = (
                codec_rows[name].to_numpy(float) for name in (quantity.column, "low", "high")
            )
            curve = Curve(np.arange(len(rates), dtype=float), y, low, high)
            faint = quantity.is_time and codec in unranked_codecs(dataset_metrics)
            draw_over_rates(axes, curve, style.of_codec(codec), faint)
    next(iter(row.values())).set_ylabel(quantity.short_label)
