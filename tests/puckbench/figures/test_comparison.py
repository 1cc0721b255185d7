"""The figure of a comparison: lossless rates are ticks at the edge, and axes name the peak."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from puckbench.figures.comparison import draw_comparison
from puckbench.figures.panels import set_log
from puckbench.figures.style import FigureStyle
from tests.support.reference_lookalike import rows_of


def _ticks(axes: Axes) -> list[list[list[float]]]:
    """Ends of the ticks at an edge, whose height is a share of the panel's."""
    lines = [c for c in axes.collections if isinstance(c, LineCollection)]
    ticks = [c for c in lines if c.get_transform() != axes.transData]
    return [path.vertices.tolist() for c in ticks for path in c.get_paths()]


def test_a_lossless_rate_is_a_tick_at_the_edge_of_better_values() -> None:
    own = rows_of("mine", 0.5)
    exact = own["rate"] == "r4"
    columns = {name: own[name].mask(exact) for name in ("d1_psnr", "d2_psnr")}
    own = own.assign(**columns, d1_mse=own["d1_mse"].mask(exact, 0), lossless=exact, peak=59.7)
    qualities = ["d1_psnr", "d1_mse"]
    style = FigureStyle()
    figure = draw_comparison(own, rows_of("gpcc", 0.8), qualities, "known", style)
    for axes, edge in zip(figure.axes, (1.0, 0.0), strict=True):
        ((start, end),) = _ticks(axes)
        assert start == [own[exact]["bpp"].median(), edge]
        assert end == [start[0], pytest.approx(abs(edge - 0.07))]
        drawn = [y for line in axes.lines for y in np.asarray(line.get_ydata(), float)]
        assert 0 < min(drawn) < max(drawn) < 100
    assert figure.axes[0].get_ylabel() == "D1 PSNR (dB), better \N{RIGHTWARDS ARROW}\npeak 59.7"
    assert figure.axes[1].get_ylabel() == "D1 MSE (grid units²), \N{LEFTWARDS ARROW} better"
    assert "bits of lossless streams" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_without_lossless_rates_nothing_is_said_of_them() -> None:
    own, style = rows_of("mine", 0.5), FigureStyle()
    figure = draw_comparison(own, rows_of("gpcc", 0.8), ["d1_psnr"], "known", style)
    assert _ticks(figure.axes[0]) == []
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert not any("lossless" in text for text in texts)


def test_codecs_keep_their_colours_and_markers_and_the_reference_is_pale() -> None:
    style = FigureStyle()
    own, reference = rows_of("draco", 0.5), rows_of("gpcc", 0.8)
    figure = draw_comparison(own, reference, ["d1_psnr"], "known", style)
    drawn = {line.get_color(): line for line in figure.axes[0].lines}
    for codec, alpha in (("draco", 1.0), ("gpcc", 0.5)):
        line = drawn[style.of_codec(codec).colour]
        assert (line.get_marker(), line.get_alpha()) == (style.of_codec(codec).marker, alpha)


def test_medians_of_several_peaks_are_not_drawn() -> None:
    own = pd.concat([rows_of("mine", 0.5)])
    own["peak"] = np.where(own["cloud"] == "thing_0", 511.0, 1023.0)
    figure = draw_comparison(own, rows_of("gpcc", 0.8), ["d1_psnr"], "known", FigureStyle())
    drawn = [line for line in figure.axes[0].lines if line.get_linestyle() == "-"]
    assert [len(line.get_xdata()) for line in drawn] == [5]  # the reference's curve alone


@pytest.mark.parametrize(
    ("limits", "width_in", "labels"),
    [
        ((13.0, 60.0), 3.5, ["20", "30", "40", "50", "60"]),
        ((2.0, 30.0), 3.5, ["2", "5", "10", "20"]),
        ((0.5, 30.0), 1.5, ["1", "3", "10", "30"]),
        ((0.02, 30.0), 1.5, ["0.1", "1", "10"]),
        ((1e-6, 1e6), 3.5, None),
    ],
)
def test_an_axis_has_as_many_numbers_as_fit(
    limits: tuple[float, float], width_in: float, labels: list[str] | None
) -> None:
    from matplotlib.figure import Figure

    axes = Figure(figsize=(width_in, 2)).add_subplot()
    set_log(axes, "x", limits)
    axes.figure.draw_without_rendering()
    low, high = limits
    shown = [t.get_text() for t in axes.get_xticklabels() if low <= t.get_position()[0] <= high]
    assert labels is None or shown == labels
    boxes = [t.get_window_extent() for t in axes.get_xticklabels()]
    assert all(a.x1 <= b.x0 for a, b in pairwise(boxes) if a.width and b.width)
