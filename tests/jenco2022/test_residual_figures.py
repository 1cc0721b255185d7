"""Chapter 5's figures of residuals: densities, samples and published numbers as they are drawn."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jenco2022.figures import residual_incidence, residual_violins
from jenco2022.figures import residual_table as parts
from jenco2022.figures.model_styles import MODEL_STYLES, model_style, ordered_models
from jenco2022.figures.residual_table import moments_text, symmetric_limit, violin_shape
from pointkit.errors import InputError
from pointkit.seeding import generator
from puckbench.figures.drawing import lay_out, save_figure
from puckbench.figures.registry import figure_entries, figure_entry
from puckbench.figures.style import FigureStyle
from tests.support.residuals_lookalike import ELEVATIONS, REAL_STD_M, residual_table
from virtual_lidar.errors import error_model_names

FROM_RESIDUALS = [
    name for name, entry in figure_entries().items() if entry.inputs == ("residuals",)
]
VIOLINS_M = {"fig_5_18": 0.3} | dict.fromkeys(
    ("fig_5_10", "fig_5_11", "fig_5_12", "fig_5_13", "fig_5_14", "fig_5_19"), 0.15
)


def draw(name: str, table: pd.DataFrame, style: FigureStyle | None = None) -> Figure:
    style = style or FigureStyle()
    with style.context():
        figure: Figure = figure_entry(name).draw(residuals=table, style=style)
    return figure


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def colours(axes: Axes) -> list[tuple[float, ...]]:
    """Colour of every violin or point cloud of a panel, without its opacity."""
    return [tuple(drawn.get_facecolor()[0][:3]) for drawn in axes.collections if _filled(drawn)]


def _filled(drawn: object) -> bool:
    return type(drawn).__name__ in {"FillBetweenPolyCollection", "PolyCollection", "PathCollection"}


@pytest.mark.parametrize(
    ("name", "surface"),
    [("fig_5_11", "Wall"), ("fig_5_12", "Floor"), ("fig_5_13", "Floor"), ("fig_5_14", "Wall")],
)
def test_a_figure_of_one_surface_says_which(name: str, surface: str) -> None:
    assert draw(name, residual_table(60)).axes[0].get_title().startswith(f"{surface}, n = ")


def test_the_density_of_a_gaussian_is_the_gaussian() -> None:
    std = 0.014
    shape = violin_shape(std * generator(1, "violin").normal(size=200_000))
    expected = np.exp(-0.5 * (shape["coords"] / std) ** 2) / (std * np.sqrt(2 * np.pi))
    assert np.abs(shape["vals"] - expected).max() < 0.03 * expected.max()
    assert np.trapezoid(shape["vals"], shape["coords"]) == pytest.approx(1, abs=0.01)


def test_one_far_outlier_does_not_flatten_a_density() -> None:
    values = np.append(0.014 * generator(1, "violin").normal(size=50_000), 3.0)
    shape = violin_shape(values)
    widest = shape["vals"] > 0.5 * shape["vals"].max()
    width = np.ptp(shape["coords"][widest])
    assert width == pytest.approx(2.355 * 0.014, rel=0.1)  # full width at half maximum
    assert shape["max"] == 3.0


@pytest.mark.parametrize("values", [[0.0], [0.01, 0.01, 0.01], [0.0, 1e-7], [-0.1, 0.1]])
def test_few_or_equal_residuals_have_a_shape(values: list[float]) -> None:
    shape = violin_shape(np.array(values))
    assert len(shape["coords"]) == len(shape["vals"])
    assert np.isfinite(shape["vals"]).all()
    assert shape["vals"].max() > 0


def test_limits_widen_in_steps_of_5_cm_only_where_needed() -> None:
    assert symmetric_limit(np.array([-0.149, 0.1]), 0.15) == 0.15
    assert symmetric_limit(np.array([-0.151, 0.1]), 0.15) == pytest.approx(0.2)


def test_moments_are_written_as_in_the_thesis() -> None:
    assert moments_text(np.array([-0.0151, 0.0131])) == "$\\mu$ = \u22120.001\n$\\sigma$ = 0.014"
    assert moments_text(np.array([-1e-7])).startswith("$\\mu$ = 0.000")


def test_bins_of_incidence_have_the_moments_of_their_points() -> None:
    x = np.array([0.0, 0.05, 0.95, 1.0])
    x[-1] = 0.99
    centres, means, stds = parts.binned_moments(x, np.array([1.0, 3.0, 5.0, 5.0]), 0.1)
    np.testing.assert_allclose(centres, np.arange(0.05, 1.0, 0.1))
    assert (means[0], stds[0], means[-1], stds[-1]) == (2.0, 1.0, 5.0, 0.0)
    assert np.isnan(means[1:-1]).all()


def test_a_subsample_is_seeded_and_without_repeats() -> None:
    table = pd.DataFrame({"residual_m": np.arange(1000.0)})
    once, again = (parts.subsample(table, 300, "vlp16") for _ in range(2))
    assert once.equals(again)
    assert once["residual_m"].nunique() == 300
    assert not once.equals(parts.subsample(table, 300, "none"))
    assert parts.subsample(table, 1000, "vlp16").equals(table)


def test_every_error_model_has_a_colour_of_its_own() -> None:
    original = {plot_style.colour for plot_style in MODEL_STYLES.values()}
    assert len(original) == len(MODEL_STYLES)
    assert set(error_model_names()) <= set(MODEL_STYLES)


def test_what_the_thesis_compares_differs_in_lightness_or_hue_for_everyone() -> None:
    deuteranopia = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
    shown = ("real", "none", "hdl64e", "vlp16", "vlp16_divergence")
    for a, b in combinations(shown, 2):
        rgb = [
            np.array([int(MODEL_STYLES[model].colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
            for model in (a, b)
        ]
        assert np.abs(deuteranopia @ (rgb[0] ** 2.2 - rgb[1] ** 2.2)).max() > 0.05, (a, b)


def test_an_unknown_model_looks_the_same_everywhere_and_stands_last() -> None:
    style = FigureStyle(colours={"vlp16": "#123456"})
    assert model_style("my_model", style) == model_style("my_model", FigureStyle())
    assert model_style("vlp16", style).colour == "#123456"
    assert ordered_models(["my_model", "vlp16", "real"]) == ["real", "vlp16", "my_model"]


@pytest.mark.parametrize("name", FROM_RESIDUALS)
@pytest.mark.parametrize("real", [True, False])
def test_every_figure_is_drawn_with_and_without_a_capture(
    name: str, real: bool, tmp_path: Path
) -> None:
    style = FigureStyle(dpi=30)
    figure = draw(name, residual_table(60, real), style)
    with style.context():
        lay_out(figure)
        save_figure(figure, tmp_path / "figure.png")
    for legend in figure.legends:
        box, page = legend.get_window_extent(), figure.bbox
        assert page.x0 <= box.x0 < box.x1 <= page.x1
    labels = [axes.get_ylabel() for axes in figure.axes] + [figure.get_supylabel()]
    assert "Plane residual (m)" in labels


@pytest.mark.parametrize(("name", "limit"), VIOLINS_M.items())
def test_violins_keep_the_thesis_range_until_data_fall_outside(name: str, limit: float) -> None:
    table = residual_table(60)
    table["residual_m"] = table["residual_m"].clip(-0.14, 0.14)
    assert draw(name, table).axes[0].get_ylim()[1] == limit
    table["residual_m"] *= 20
    low, high = draw(name, table).axes[0].get_ylim()
    drawn = table if name == "fig_5_18" else table[table["model"].isin(["real", "vlp16"])]
    assert low < -limit
    assert high > min(limit, drawn["residual_m"].abs().max())


def test_real_and_virtual_stand_side_by_side_and_are_named() -> None:
    figure = draw("fig_5_11", residual_table(60))
    assert texts(figure) == ["Real VLP-16", "Virtual (Beam divergence)"]
    assert len(colours(figure.axes[0])) == 10
    assert len(set(colours(figure.axes[0]))) == 2
    ticks = [tick.get_text() for tick in figure.axes[0].get_xticklabels()]
    assert ticks == ["1", "2", "3", "4", "5"]  # 30 m belongs to Figure 5.19 alone


def test_without_a_capture_the_published_numbers_stand_in_and_say_so() -> None:
    figure = draw("fig_5_10", residual_table(60, real=False))
    assert texts(figure)[-1] == "Not captured; thesis: std \u00b10.014 m"
    levels = {line.get_ydata()[0] for line in figure.axes[0].get_lines()}
    assert {-REAL_STD_M, REAL_STD_M} <= levels


def test_lasers_stand_by_elevation() -> None:
    ticks = draw("fig_5_14", residual_table(200)).axes[0].get_xticklabels()
    drawn = [int(tick.get_text().replace("\u2212", "-")) for tick in ticks]
    assert drawn == sorted(ELEVATIONS)


def test_figure_5_18_writes_each_models_moments() -> None:
    written = [text.get_text() for text in draw("fig_5_18", residual_table(4000)).axes[0].texts]
    assert len(written) == 5
    assert written[0] == "$\\mu$ = 0.000\n$\\sigma$ = 0.014"
    assert written[1] == "$\\mu$ = 0.000\n$\\sigma$ = 0.000"


def test_a_model_has_one_colour_in_all_figures() -> None:
    table = residual_table(60)
    violin = colours(draw("fig_5_19", table).axes[0])[1]
    panel = colours(draw("fig_5_20", table).axes[3])[0]
    assert violin == panel == colours(draw("fig_5_10", table).axes[0])[1]


def test_samples_are_as_large_as_the_thesis_s(monkeypatch: pytest.MonkeyPatch) -> None:
    assert (residual_incidence.SAMPLE, residual_violins.SAMPLE) == (30_000, 100_000)
    monkeypatch.setattr(residual_incidence, "SAMPLE", 100)
    for axes in draw("fig_5_20", residual_table(60)).axes:
        assert len(axes.collections[0].get_offsets()) == 100


def test_bars_of_figure_5_15_follow_the_cosine_of_the_virtual_sensor() -> None:
    bars = draw("fig_5_15", residual_table(3000)).axes[-1].containers
    assert len(bars) == 2
    half = [np.ptp(np.array(bar[2][0].get_segments())[:, :, 1], axis=1) / 2 for bar in bars]
    np.testing.assert_allclose(half[0], REAL_STD_M, rtol=0.1)
    centres = bars[1][0].get_xdata()
    expected = np.hypot(0.014, 0.010) * np.cos(centres)
    np.testing.assert_allclose(half[1][:-1], expected[:-1], rtol=0.2)  # the last bin is not full
    np.testing.assert_allclose(np.diff(centres), 0.1315)


def test_figure_5_20_leaves_out_what_the_thesis_discounted() -> None:
    titles = [axes.get_title() for axes in draw("fig_5_20", residual_table(60)).axes]
    names = [title.partition(" (n = ")[0] for title in titles]
    assert names == ["Real VLP-16", "No noise", "VLP-16", "Beam divergence"]


@pytest.mark.parametrize(
    ("name", "change", "fault"),
    [
        ("fig_5_10", {"residual_m": "x"}, "'residual_m' has values that are not numbers"),
        ("fig_5_15", {"incidence_rad": np.inf}, "'incidence_rad' has a missing or infinite value"),
        ("fig_5_11", {"surface": "floor"}, "no wall nearer than 30 m"),
        ("fig_5_19", {"distance_m": 5.0}, "no surface at 30 m or farther"),
        ("fig_5_19", {"model": "vlp16"}, "no row of the model 'vlp16_divergence' at 30 m"),
    ],
)
def test_what_cannot_be_drawn_is_named(name: str, change: dict[str, object], fault: str) -> None:
    with pytest.raises(InputError, match=f"residual table: .*{fault}"):
        draw(name, residual_table(5).assign(**change))


def test_a_missing_column_is_named() -> None:
    with pytest.raises(InputError, match="residual table: no column 'elevation_deg'"):
        draw("fig_5_13", residual_table(5).drop(columns="elevation_deg"))


def test_the_same_table_gives_the_same_bytes(tmp_path: Path) -> None:
    style, table = FigureStyle(dpi=40), residual_table(60)
    for path in (tmp_path / "a.pdf", tmp_path / "b.pdf"):
        figure = draw("fig_5_20", table, style)
        with style.context():
            save_figure(figure, path)
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()
