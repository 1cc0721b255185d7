"""Figures of clouds in metres: what is drawn where."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.figures.plot_styles import codec_style
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.tables.noise_bits import noise_bits
from tests.support.figures_lookalike import (
    sweeps_clouds_table,
    sweeps_scan_errors_table,
    sweeps_table,
)
from tests.support.returns import recorded


def draw(name: str, **inputs: Any) -> Figure:
    style = FigureStyle()
    with style.context():
        figure: Figure = figure_entry(name).draw(**inputs, style=style)
    return figure


def test_errors_are_in_millimetres_over_bits() -> None:
    figure = draw("sweeps_rd", metrics=sweeps_table(clouds=1))
    assert len(figure.axes) == 3
    for axes in figure.axes:
        drawn = {line.get_color(): line.get_xydata() for line in axes.get_lines()}
        gpcc = drawn[codec_style("gpcc").colour]
        rows = sweeps_table(clouds=1).query("codec == 'gpcc' and dataset == 'rooms'")
        if axes is figure.axes[0]:
            np.testing.assert_allclose(gpcc[:, 1], 1000 * rows["d1_rms_m"])
            np.testing.assert_allclose(gpcc[:, 0], rows["bpp"])
        (left, right), low = axes.get_xlim(), axes.get_ylim()[0]
        assert ((left <= gpcc[:, 0]) & (gpcc[:, 0] <= right)).all()
        assert (drawn[codec_style("puck").colour][:, 1] > low).all()
        # A stream without loss is a tick at the lower edge.
        assert any(c.get_transform() != axes.transData for c in axes.collections)


def test_a_recording_has_no_panel_of_the_truth_and_the_scan_a_line() -> None:
    figure = draw("sweeps_truth", metrics=sweeps_table(), scan_errors=sweeps_scan_errors_table())
    assert len(figure.axes) == 2
    level = [line for line in figure.axes[1].get_lines() if len(set(line.get_ydata())) == 1]
    assert 10.0 in [line.get_ydata()[0] for line in level]


def test_errors_of_ranges_are_drawn_over_bits() -> None:
    figure = draw("sweeps_ranges", metrics=sweeps_table(clouds=1))
    assert "RMS error of ranges" in figure.axes[0].get_ylabel()
    drawn = {line.get_color(): line.get_ydata() for line in figure.axes[0].get_lines()}
    rows = sweeps_table(clouds=1).query("codec == 'gpcc' and dataset == 'rooms'")
    np.testing.assert_allclose(drawn[codec_style("gpcc").colour], rows["range_rms_mm"])


def _noise_rows() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Spins of two models by a codec that is exact, one on a grid of 1 mm, and a coarser one."""
    metrics, clouds = sweeps_table(3), sweeps_clouds_table(3)
    grid = metrics.query("codec == 'gpcc'").copy()
    grid.loc[grid["rate"] == "10mm", "d1_rms_m"] = 0.0005
    grid.loc[grid["dataset"] == "rooms_vlp16", "bpp"] += 6
    return pd.concat([metrics.query("codec == 'puck'"), grid, grid.assign(
        codec="reno", d1_rms_m=grid["d1_rms_m"] + 0.004, bpp=2 * grid["bpp"]
    )]), clouds  # fmt: skip


def test_what_noise_costs_is_drawn_at_equal_errors() -> None:
    metrics, clouds = _noise_rows()
    figure = draw("noise_cost", metrics=metrics, clouds=clouds)
    exact, at_error = figure.axes
    titles = {name: codec_style(name).title for name in ("puck", "gpcc", "reno")}
    assert [tick.get_text() for tick in exact.get_yticklabels()] == [
        "entropy of the noise", titles["puck"], titles["gpcc"],
    ]  # fmt: skip
    table = noise_bits(metrics, clouds).set_index(["codec", "error_model"])
    none, vlp16 = [line.get_xdata() for line in exact.get_lines()[-2:]]
    assert exact.get_title() == "Rooms: lossless, or 1 mm (n = 3)"
    for drawn, model, noise in ((none, "none", 0.0), (vlp16, "vlp16", 4.4)):
        bits = [table.loc[(codec, model), "grid_1_mm"] for codec in ("puck", "gpcc")]
        np.testing.assert_allclose(drawn, [noise, *bits])
    shown = [tick.get_text() for tick in at_error.get_yticklabels()]
    assert set(shown) == {titles["gpcc"], titles["reno"]}  # puck has 6.7 mm, then none
    gpcc = table.loc[("gpcc", "vlp16"), "at_5_mm"]
    assert at_error.get_lines()[-1].get_xdata()[shown.index(titles["gpcc"])] == pytest.approx(gpcc)
    legend = {text.get_text() for text in figure.legends[0].get_texts()}
    assert legend == {"No noise", "VLP-16", "range of the models"}  # no interval of three rooms


def test_codecs_that_reach_neither_error_are_an_input_error() -> None:
    metrics, clouds = _noise_rows()
    with pytest.raises(InputError, match="no codec reaches"):
        draw("noise_cost", metrics=metrics.assign(d1_rms_m=0.5), clouds=clouds)


def test_nothing_to_draw_is_an_input_error() -> None:
    with pytest.raises(InputError, match="no rows, nothing to draw"):
        draw("sweeps_rd", metrics=sweeps_table(1).iloc[:0])
    recordings = sweeps_clouds_table(2).query("dataset == 'recording'")
    with pytest.raises(InputError, match="no cloud has an entropy"):
        draw("noise_cost", metrics=sweeps_table(2), clouds=pd.DataFrame(recordings))
    with pytest.raises(InputError, match="has no returns"):
        draw("spin_images", example_spin=PointCloud(recorded().points()))


def _modes(datasets: tuple[str, ...]) -> pd.DataFrame:
    """Spins by the octree, by its angular mode for three quarters of the bits, and by another."""
    octree = sweeps_table(2).query("codec == 'gpcc'")
    result = [octree.assign(dataset=name) for name in datasets]
    result += [item.assign(codec="gpcc_angular", bpp=0.75 * item["bpp"]) for item in result]
    result += [item.assign(codec="laz", bpp=9 * item["bpp"]) for item in result[:1]]
    return pd.concat(result).reset_index(drop=True)


def test_bits_are_drawn_as_shares_of_the_octrees() -> None:
    metrics = _modes(("rooms", "rooms_vlp16"))
    clouds = sweeps_clouds_table(2).assign(sensor="VLP-16")
    figure = draw("handicap", metrics=metrics, clouds=clouds)
    (axes,) = figure.axes  # the second data set differs in its errors alone
    shares = [
        np.asarray(line.get_ydata(), float)
        for line in axes.get_lines()
        if line.get_color() == codec_style("gpcc_angular").colour
    ]
    drawn = shares[0][np.isfinite(shares[0])]
    assert len(drawn) > 10
    np.testing.assert_allclose(drawn, 75)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert codec_style("gpcc_angular").title in texts
    assert codec_style("laz").title in texts  # nine times the octree's bits are on the axes
    assert axes.get_ylim()[1] > 900
    assert axes.get_title() == "Rooms (n\xa0=\xa02)"
    alone = metrics[metrics["codec"] != "gpcc"]
    with pytest.raises(InputError, match="coded by gpcc and by another"):
        draw("handicap", metrics=alone, clouds=clouds)


def test_every_codec_of_a_run_is_drawn_beside_the_octree() -> None:
    metrics = _modes(("rooms",))
    octree = metrics[metrics["codec"] == "gpcc"]
    mine = octree.assign(codec="mine", bpp=0.5 * octree["bpp"])
    figure = draw(
        "handicap",
        metrics=pd.concat([metrics, mine]),
        clouds=sweeps_clouds_table(2).assign(sensor="VLP-16"),
    )
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"mine", codec_style("gpcc_angular").title} <= set(texts)
    assert codec_style("gpcc_lossless").title not in texts
