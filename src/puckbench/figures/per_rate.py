from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from puckbench.figures.axis_labels import CD_PLANE, DECODE_TIME, ENCODE_TIME, HD_PLANE, axis_label
from puckbench.figures.binning import medians_per_rate, ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.curves import mark_handles
from puckbench.figures.panels import (
    add_fitting_legend,
    draw_curve,
    label_rates,
    line_handle,
    log_limits,
    panel_grid,
    set_log,
    titled,
    unranked_handle,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.metrics.timing import unranked_codecs

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_COLUMNS = (CD_PLANE, HD_PLANE, ENCODE_TIME, DECODE_TIME)


@FIGURES.register(
    "medians_per_rate", title="Medians per compression rate", category="Results per rate"
)
def draw_medians_per_rate(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Medians over n clouds at each compression rate of each codec (rows), in order of bits.

    Columns are the Chamfer distance and the squared Hausdorff distance (both point-to-plane, in
    squared grid units), and the encoding and decoding times in seconds, without the start of a
    process. Bars are quartiles; with fewer than six clouds, there is a dot for each cloud instead.
    Ticks at the lower edge mark lossless rates.
    """
    columns = tuple(quantity.name for quantity in _COLUMNS)
    require_rows(metrics, ("dataset", "cloud", "codec", "rate", *columns), "metrics")
    require_numbers(metrics, columns, "metrics")
    codecs, abreast = style.ordered_codecs(metrics["codec"]), len(_COLUMNS)
    looks = style.of_datasets(metrics["dataset"])
    parts = {name: metrics[metrics["dataset"] == name] for name in looks}
    unranked = {name: unranked_codecs(rows) for name, rows in parts.items()}
    shape = len(codecs) * abreast, abreast
    figure, panels = panel_grid(*shape, 1.3, style, sharey="col", sharex="row")
    curves = []
    for index, axes in enumerate(panels):
        codec, quantity = codecs[index // abreast], _COLUMNS[index % abreast]
        values = metrics[quantity.name].to_numpy(dtype=float)
        set_log(axes, "y", log_limits(values, quantity.name, style), minor=False)
        codec_rows = {name: rows[rows["codec"] == codec] for name, rows in parts.items()}
        rates = ordered_rates(metrics.loc[metrics["codec"] == codec, "rate"])
        for name, rows in codec_rows.items():
            curve = medians_per_rate(rows, quantity.name, rates)
            if np.isfinite(curve.y).any():
                is_faint = quantity.timed and codec in unranked[name]
                draw_curve(axes, curve, looks[name], is_faint)
                curves.append({name: curve})
        label_rates([axes], rates, abreast)
        axes.set_ylabel(axis_label(quantity, 2))
        if index % abreast == 0:
            axes.set_title(style.of_codec(codec).title, loc="left", fontweight="bold", pad=3)
    figure.supxlabel("Compression rate of the codec", fontsize=style.font_size)
    handles = [
        line_handle(titled(look.title, parts[name]), color=look.colour, marker=look.marker)
        for name, look in looks.items()
    ]
    handles += [unranked_handle()] if any(unranked.values()) else []
    add_fitting_legend(figure, [*handles, *mark_handles(curves)], style)
    return figure
