from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError
from puckbench.figures.axis_labels import BETTER
from puckbench.figures.curves import draw_data_sets
from puckbench.figures.panels import panel_grid, set_title
from puckbench.figures.plot_styles import codec_style
from puckbench.figures.registry import FIGURES, SPINS
from puckbench.figures.style import FigureStyle
from puckbench.results.columns import LOWER, Column, column_named
from puckbench.tables.registry import SPINS_OR_RECORDINGS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from pointkit.geometry.cloud import Floats, PointCloud
    from pointkit.lidar.returns import Returns

CODE = ("puckbench.codecs.base", "puckbench.codecs.puck")

BITS = f"Bits per return, {BETTER}"
ERROR = Column("error_mm", "RMS error to the scan (D1)", "mm", LOWER)
TO_TRUTH = Column("truth_mm", "RMS distance to the truth (D2)", "mm", LOWER)
RANGES = column_named("range_rms_mm")
_SOURCES = {"error_mm": "d1_rms_m", "truth_mm": "truth_d2_rms_m"}
_PANEL_IN = 2.1


@FIGURES.register(
    "sweeps_rd",
    title="Error of decoded spins against bits per return",
    category="Spins of a sensor",
    frame="metric",
)
def draw_error(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """D1 RMS error (the larger of both directions) in millimetres, against bits per return, as
    medians over clouds.

    A cloud is one or more turns (revolutions) of a virtual or real sensor, in the sensor's frame.
    Lossless streams are drawn at the lower edge.
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
    """RMS distance to the true surface (point to plane, the larger of both directions) in
    millimetres, against bits per return, for turns of a virtual sensor, as medians over clouds.

    The dashed line is the distance of the scan before coding, which is also that of lossless
    codecs. Below this line, decoded points are nearer to the true surface than the scan is.
    """
    scan_medians = _in_millimetres(scan_errors).groupby("dataset")["truth_mm"].median()
    rows = _in_millimetres(metrics)
    measured = set(rows.dropna(subset=["truth_mm"])["dataset"]) & set(scan_medians.index)
    rows = rows[rows["dataset"].isin(measured)]
    return _draw(
        rows, TO_TRUTH, style, {str(name): float(scan_medians[name]) for name in scan_medians.index}
    )


def _in_millimetres(table: pd.DataFrame) -> pd.DataFrame:
    converted = {name: 1000 * table[m] for name, m in _SOURCES.items() if m in table}
    return table.assign(**converted)


def _draw(
    metrics: pd.DataFrame, metric: Column, style: FigureStyle, scans: Mapping[str, float]
) -> Figure:
    return draw_data_sets(metrics, metric, style, bits=BITS, panel_in=_PANEL_IN, scans=scans)


@FIGURES.register(
    "sweeps_ranges",
    title="Error of decoded ranges against bits per return",
    category="Spins of a sensor",
    frame="metric",
    needs=(SPINS_OR_RECORDINGS,),
)
def draw_ranges(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """RMS error of ranges in millimetres, against bits per return, as medians over clouds.

    If a codec decodes points instead of returns, the error is the offset, along the ray, of the
    nearest point. Lossless streams are drawn at the lower edge.
    """
    return _draw(metrics, RANGES, style, {})


@FIGURES.register(
    "spin_images",
    title="A spin as range images: measured, decoded, error",
    category="Spins of a sensor",
    frame="metric",
)
def draw_images(example_spin: PointCloud, style: FigureStyle) -> Figure:
    """One turn (revolution of the sensor) as range images, whose rows are lasers by elevation, and
    whose columns are azimuths in the order of firing. The upper image shows measured ranges (m),
    the middle one ranges decoded by ``puck`` at rate ``100mm``, and the lower one the error
    (mm). White pixels have no return.
    """
    from puckbench.codecs.coding import decoded, encoded
    from puckbench.codecs.registry import open_codec

    returns = example_spin.returns
    if returns is None:
        raise InputError("the example spin has no returns (figures.examples.spin)")
    codec, rate = open_codec("puck"), "100mm"
    codec.load()
    coded = decoded(codec, encoded(codec, example_spin, rate)).returns
    assert coded is not None  # noqa: S101 (a codec of returns)
    images = [_image(sweep) for sweep in (returns, coded)]
    error = 1000 * (images[1] - images[0])
    figure, panels = panel_grid(3, 1, 1.0, style)
    elevations = np.asarray(returns.beams.elevations_deg)[list(returns.layout.order)]
    azimuths = np.unwrap(returns.column_azimuths(returns.turns[0])[:, 0])
    extent = (*np.degrees(azimuths[[0, -1]]).tolist(), -0.5, len(elevations) - 0.5)
    lasers = np.linspace(0, len(elevations) - 1, 4).round().astype(int)
    limits = (0.0, float(np.nanquantile(images[0], 0.98)))
    largest_error = float(np.nanmax(np.abs(error)))
    rows = (
        (images[0], "measured", "viridis_r", limits, "m"),
        (images[1], f"decoded, {codec_style('puck').title} at {rate}", "viridis_r", limits, "m"),
        (error, "error", "RdBu", (-largest_error, largest_error), "mm"),
    )
    for axes, (image, title, colours, (low, high), unit) in zip(panels, rows, strict=True):
        mappable = axes.imshow(
            image, cmap=colours, vmin=low, vmax=high, aspect="auto", interpolation="nearest",
            origin="lower", extent=extent,
        )  # fmt: skip
        axes.grid(visible=False)
        axes.set_yticks(lasers, [f"{elevations[laser]:.0f}" for laser in lasers])
        axes.set_ylabel("Elevation (°)")
        set_title(axes, title, 1, style)
        figure.colorbar(mappable, ax=axes, label=f"Range ({unit})" if unit == "m" else "Error (mm)")
    panels[-1].set_xlabel("Azimuth (°)")
    return figure


def _image(returns: Returns) -> Floats:
    """Return the first returns of the first turn as a range image (lasers, columns), in m."""
    ranges = returns.distances(returns.turns[0])[0][:, list(returns.layout.order)].T
    return np.where(ranges > 0, ranges, np.nan)
