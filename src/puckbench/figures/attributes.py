from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError
from puckbench.figures.axis_labels import BETTER, HIGHER_BETTER
from puckbench.figures.checks import require_rows
from puckbench.figures.panels import (
    add_legend,
    draw_edge_ticks,
    draw_line,
    log_limits,
    lossless_tick_handle,
    set_log,
    set_title,
    titled,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import PAGE_WIDTH_IN, FigureStyle
from puckbench.tables.attribute_bits import BITS, attribute_bits, coded_attributes
from puckbench.tables.registry import ATTRIBUTES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("puckbench.tables.attribute_bits",)

_PSNR = {"reflectance": "reflectance_psnr", "colour": "y_psnr"}
_BAR_IN, _CURVES_IN, _AROUND_IN = 0.16, 1.7, 1.3
_GEOMETRY = "#bdbdbd"


@FIGURES.register(
    "attributes",
    title="Bits of reflectances and colours",
    category="Attributes",
    needs=(ATTRIBUTES,),
    frame="metric",
)
def draw_attributes(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Bits and PSNR of attributes (reflectances and colours), as medians over n clouds. The upper
    panels show bits per point of lossless codecs: grey for the positions, coloured and with the
    value for the attribute. The lower panels show the PSNR of the attribute (for colours, of
    their luma) against its bits at lossy rates. Ticks at the upper edge mark the bits of
    lossless rates.

    Parameters
    ----------
    metrics
        Results of a run.
    style
        Style of the figure.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    require_rows(metrics, ("dataset", "cloud", "codec", "rate", "bpp"), "metrics")
    rows = coded_attributes(metrics)
    table = attribute_bits(rows)
    tables = {
        (dataset, kind): part
        for dataset in style.ordered_datasets(table["dataset"])
        for kind, bits in BITS.items()
        if f"{kind}_lossless" in table
        and len(part := table[(table["dataset"] == dataset) & table[bits].notna()])
    }
    if not tables:
        raise InputError("metrics table: no decoded attribute has been measured")
    exact = style.ordered_codecs(
        codec for (_, kind), part in tables.items() for codec in _lossless(part, kind).index
    )
    bars_in = _BAR_IN * (len(exact) + 1)
    size = (style.width_in or PAGE_WIDTH_IN, bars_in + _CURVES_IN + _AROUND_IN)
    figure = Figure(figsize=size)
    grid = figure.subplots(2, len(tables), height_ratios=[bars_in, _CURVES_IN], squeeze=False)
    for (above, below), ((dataset, kind), part) in zip(grid.T, tables.items(), strict=True):
        _draw_bars(above, part, kind, exact, style, labels=above is grid[0, 0])
        dataset_rows = rows[(rows["dataset"] == dataset) & rows[BITS[kind]].notna()]
        set_title(
            above, titled(f"{style.title(dataset)}, {kind}", dataset_rows), len(tables), style
        )
        above.set_xlabel("Bits per point")
        _draw_curves(below, part, kind, style)
        below.set_xlabel(f"Bits of {kind}, {BETTER}")
    grid[1, 0].set_ylabel(f"PSNR (dB), {HIGHER_BETTER}")
    drawn = [_lossy(part, kind)["codec"] for (_, kind), part in tables.items()]
    handles = [Patch(color=_GEOMETRY, label="bits of positions"), lossless_tick_handle()]
    add_legend(figure, style.ordered_codecs(set().union(*drawn)), style, handles)
    return figure


def _lossless(table: pd.DataFrame, kind: str) -> pd.DataFrame:
    exact = table[table[f"{kind}_lossless"] == True]  # noqa: E712 (may be missing)
    return exact.sort_values(BITS[kind]).drop_duplicates("codec").set_index("codec")


def _lossy(table: pd.DataFrame, kind: str) -> pd.DataFrame:
    return table[table[_PSNR[kind]].notna() & (table[f"{kind}_lossless"] == False)]  # noqa: E712


def _draw_bars(
    axes: Axes, table: pd.DataFrame, kind: str, codecs: list[str], style: FigureStyle, labels: bool
) -> None:
    exact = _lossless(table, kind).reindex(codecs)
    geometry, bits = (exact[name].to_numpy(float) for name in ("bpp_geometry", BITS[kind]))
    looks = [style.of_codec(codec) for codec in codecs]
    places = np.arange(len(codecs))
    axes.barh(places, geometry, color=_GEOMETRY)
    axes.barh(places, bits, left=geometry, color=[look.colour for look in looks])
    for place, start, value in zip(places.tolist(), geometry, bits, strict=True):
        if np.isfinite(value):
            axes.text(start + value, place, f" {value:.2f}", va="center", fontsize="small")
    axes.set_yticks(places, [look.title for look in looks] if labels else [])
    axes.set_ylim(len(codecs) - 0.4, -0.6)
    axes.set_xlim(0, 1.2 * float(np.nanmax(geometry + bits, initial=1.0)))
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")


def _draw_curves(axes: Axes, table: pd.DataFrame, kind: str, style: FigureStyle) -> None:
    lossy = _lossy(table, kind)
    set_log(axes, "x", log_limits(table[BITS[kind]].to_numpy(float), BITS[kind], style))
    for codec in style.ordered_codecs(lossy["codec"]):
        curve = lossy[lossy["codec"] == codec].sort_values(BITS[kind])
        x, y = (curve[name].to_numpy(float) for name in (BITS[kind], _PSNR[kind]))
        draw_line(axes, x, y, style.of_codec(codec))
    for name, bits in _lossless(table, kind)[BITS[kind]].items():
        draw_edge_ticks(axes, np.array([bits]), style.of_codec(str(name)), edge=1.0)
