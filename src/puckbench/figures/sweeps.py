"""Spins of a sensor, in metres: bits per return against error, and what noise costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.curves import draw_data_sets
from puckbench.figures.panels import (
    SCAN_LINE,
    add_legend,
    draw_over_rates,
    panel_grid,
    set_title,
)
from puckbench.figures.quantities import Quantity
from puckbench.figures.registry import FIGURES, SEVERAL_NOISES, SPINS
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from puckbench.geometry.cloud import Floats, PointCloud
    from puckbench.lidar.returns import Returns

BITS = "Bits per return"
ERROR = Quantity("error_mm", "RMS error to the scan (D1)", "mm", (0.1, 100))
TO_TRUTH = Quantity("truth_mm", "RMS distance to the truth (D2)", "mm", (1, 100))
_SOURCES = {"error_mm": "d1_rms_m", "truth_mm": "truth_d2_rms_m"}
_NOISE: dict[str, Any] = {**SCAN_LINE, "marker": "_"}
_PANEL_IN = 2.1


@FIGURES.register(
    "sweeps_rd",
    title="Error of decoded spins against bits per return",
    category="Spins of a sensor",
    frame="metric",
)
def draw_error(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Root mean square error (D1, the larger of both directions) in millimetres against bits per
    return, medians over the clouds at each rate.

    A spin is one or more turns of a sensor, virtual or real, in its own frame. A stream without
    loss stands on the lower edge.
    """
    return _draw(_in_millimetres(metrics), ERROR, style, {})


@FIGURES.register(
    "sweeps_truth",
    title="Distance of decoded spins to the true surface against bits per return",
    category="Spins of a sensor",
    needs=(SPINS,),
    frame="metric",
)
def draw_truth(metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle) -> Figure:
    """Root mean square distance to the true surface (point to plane, the larger of both
    directions) in millimetres against bits per return, of virtual spins.

    Dashed: the scan itself, where codecs that lose nothing level off. Below it decoded points are
    nearer to the truth than what was coded.
    """
    own = _in_millimetres(scan_errors).groupby("dataset")["truth_mm"].median()
    known = _in_millimetres(metrics)
    known = known[known["dataset"].isin(own.index)]
    return _draw(known, TO_TRUTH, style, {str(name): float(own[name]) for name in own.index})


def _in_millimetres(table: pd.DataFrame) -> pd.DataFrame:
    found = {name: 1000 * table[m] for name, m in _SOURCES.items() if m in table}
    return table.assign(**found)


def _draw(
    metrics: pd.DataFrame, quantity: Quantity, style: FigureStyle, scans: Mapping[str, float]
) -> Figure:
    return draw_data_sets(
        metrics, quantity, style, bits=BITS, panel_in=_PANEL_IN, fitted=True, scans=scans
    )


@FIGURES.register(
    "noise_cost",
    title="What the sensor's noise costs in bits",
    category="Spins of a sensor",
    needs=(SEVERAL_NOISES,),
    frame="metric",
)
def draw_noise_cost(metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Bits per return of every codec at its finest rate (exact, or 1 mm), under the sensor's error
    models; the rays and the surfaces are the same. Medians over the clouds.

    Dashed: the entropy of the noise that the model added, in steps of the sensor's ranges. No exact
    codec can need less; what lies above is the cost of the scene, and of what a codec does not know
    about the sensor. (The mean error of each laser in each turn is not counted as noise: a codec
    can learn it.)
    """
    bits = noise_bits_table(metrics, clouds)
    order = bits.groupby("error_model")["noise_bits"].median().sort_values().index
    codecs = style.ordered_codecs(bits["codec"])
    figure, (axes,) = panel_grid(1, 1, 2.6, style)
    places = np.arange(len(order))
    for codec in codecs:
        of_codec = bits[bits["codec"] == codec].groupby("error_model")["bpp"].median()
        draw_over_rates(axes, of_codec.reindex(order).to_numpy(float), style.of_codec(codec), 0)
    noise = bits.groupby("error_model")["noise_bits"].median().reindex(order)
    (line,) = axes.plot(places, noise, label="entropy of the noise", **_NOISE)
    axes.set_xticks(places, [name.replace("_", "\n", 1) for name in order])
    axes.set_xlabel("Error model")
    axes.set_ylabel(BITS)
    axes.set_ylim(bottom=0)
    axes.grid(axis="y", linewidth=0.4, alpha=0.6)
    add_legend(figure, codecs, style, (line,))
    return figure


def noise_bits_table(metrics: pd.DataFrame, clouds: pd.DataFrame) -> pd.DataFrame:
    """Bits per return at the finest rate of each cloud and codec, with the entropy of the noise.

    Scenes that were not scanned under every error model are left out.

    Parameters
    ----------
    metrics, clouds
        Of spins; clouds without `noise_bits` (recordings) are left out.

    Returns
    -------
    pd.DataFrame
        ``dataset``, ``cloud``, ``codec``, ``rate``, ``bpp``, ``error_model``, ``noise_bits``.

    Raises
    ------
    InputError
        No cloud has the entropy of its noise.
    """
    needed = ("dataset", "cloud", "error_model", "noise_bits")
    require_rows(clouds, ("dataset", "cloud"), "clouds")
    require_numbers(metrics, ("bpp",), "metrics")
    is_told = {*needed, "sensor"} <= set(clouds)
    known = clouds.dropna(subset=["noise_bits"]) if is_told else clouds.iloc[:0]
    if known.empty:
        raise InputError("clouds table: no cloud has the entropy of its noise (noise_bits)")
    models = known.groupby(["cloud", "sensor"])["error_model"].transform("nunique")
    known = known.loc[models == models.max(), list(needed)]
    finest = metrics.loc[metrics.groupby(["dataset", "cloud", "codec"])["bpp"].idxmax()]
    keys = ["dataset", "cloud"]
    return finest[[*keys, "codec", "rate", "bpp"]].merge(known, on=keys)


@FIGURES.register(
    "spin_images",
    title="A spin as range images: measured, decoded, error",
    category="Spins of a sensor",
    frame="metric",
)
def draw_images(example_spin: PointCloud, style: FigureStyle) -> Figure:
    """One turn of the sensor as it is stored: lasers from the lowest to the highest, firing columns
    from left to right. Top: measured ranges; middle: decoded from Puck at 100 mm; bottom: the
    error. White: no return.
    """
    from puckbench.codecs.registry import open_codec

    returns = example_spin.returns
    if returns is None:
        raise InputError("the example spin has no returns (figures.examples.spin)")
    codec, rate = open_codec("puck"), "100mm"
    codec.load()
    decoded = codec.decode_cloud(codec.encode_returns(returns, rate)).returns
    assert decoded is not None  # noqa: S101 (a codec of returns)
    shown = [_image(one) for one in (returns, decoded)]
    error = 1000 * (shown[1] - shown[0])
    figure, panels = panel_grid(3, 1, 1.0, style)
    limits = (0.0, float(np.nanquantile(shown[0], 0.98)))
    spread = float(np.nanmax(np.abs(error)))
    rows = (
        (shown[0], "measured", "viridis_r", limits, "m"),
        (shown[1], f"decoded, {rate}", "viridis_r", limits, "m"),
        (error, "error", "RdBu", (-spread, spread), "mm"),
    )
    for axes, (image, title, colours, (low, high), unit) in zip(panels, rows, strict=True):
        drawn = axes.imshow(
            image, cmap=colours, vmin=low, vmax=high, aspect="auto", interpolation="nearest",
            origin="lower",
        )  # fmt: skip
        axes.grid(visible=False)
        axes.set_ylabel("Laser, by\nelevation")
        set_title(axes, title, 1, style)
        figure.colorbar(drawn, ax=axes, label=f"Range ({unit})" if unit == "m" else "Error (mm)")
    panels[-1].set_xlabel("Firing column")
    return figure


def _image(returns: Returns) -> Floats:
    """Ranges (lasers, columns) in m of the first turn's first returns; nan for none."""
    ranges = returns.turns[0].ranges[0][:, list(returns.layout.order)].T * returns.quantum_m
    return np.where(ranges > 0, ranges, np.nan)
