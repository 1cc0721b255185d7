"""The figure of a comparison: lossless rates stand at the edge, and axes name the peak."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from puckbench.figures.comparison import draw_comparison
from puckbench.figures.panels import set_log
from puckbench.figures.style import FigureStyle
from tests.support.reference_lookalike import rows_of


def _lines(axes: Axes) -> dict[bool, list[tuple[list[float], list[float]]]]:
    """Data of the hollow lines and of the others."""
    found: dict[bool, list[tuple[list[float], list[float]]]] = {True: [], False: []}
    for line in axes.lines:
        x, y = (np.asarray(values, float).tolist() for values in line.get_data())
        found[line.get_markerfacecolor() == "white"].append((x, y))
    return found


def test_a_lossless_rate_stands_hollow_at_the_upper_edge() -> None:
    own = rows_of("mine", 0.5)
    exact = own["rate"] == "r4"
    columns = {name: own[name].mask(exact) for name in ("d1_psnr", "d2_psnr")}
    own = own.assign(**columns, d1_mse=own["d1_mse"].mask(exact, 0), lossless=exact, peak=59.7)
    qualities = ["d1_psnr", "d1_mse"]
    style = FigureStyle()
    figure = draw_comparison(own, rows_of("gpcc", 0.8), qualities, "known", style)
    for axes, edge in zip(figure.axes, (1.0, 0.0), strict=True):
        (hollow,) = _lines(axes)[True]
        assert hollow == ([own[exact]["bpp"].median()], [edge])
        drawn = [y for _, values in _lines(axes)[False] for y in values]
        assert max(drawn) < 100
    assert figure.axes[0].get_ylabel() == "D1 PSNR (dB)\npeak 59.7"
    assert figure.axes[1].get_ylabel() == "d1_mse"
    assert "lossless" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_without_lossless_rates_nothing_is_said_of_them() -> None:
    own, style = rows_of("mine", 0.5), FigureStyle()
    figure = draw_comparison(own, rows_of("gpcc", 0.8), ["d1_psnr"], "known", style)
    assert _lines(figure.axes[0])[True] == []
    assert "lossless" not in [text.get_text() for text in figure.legends[0].get_texts()]


def test_medians_of_several_peaks_are_not_drawn() -> None:
    own = pd.concat([rows_of("mine", 0.5)])
    own["peak"] = np.where(own["cloud"] == "thing_0", 511.0, 1023.0)
    figure = draw_comparison(own, rows_of("gpcc", 0.8), ["d1_psnr"], "known", FigureStyle())
    assert [len(x) for x, _ in _lines(figure.axes[0])[False]] == [4]


def test_an_axis_of_less_than_a_decade_has_numbers() -> None:
    from matplotlib.figure import Figure

    for limits, labels in (((13.0, 60.0), ["20", "50"]), ((2.0, 30.0), ["2", "5", "10", "20"])):
        axes = Figure().add_subplot()
        set_log(axes, "x", limits)
        axes.figure.draw_without_rendering()
        low, high = limits
        shown = [t.get_text() for t in axes.get_xticklabels() if low <= t.get_position()[0] <= high]
        assert shown == labels
