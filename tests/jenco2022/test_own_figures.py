"""The thesis's own figures: what is on them, and that files of tables suffice to draw them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from pointkit.errors import InputError
from puckbench.figures.drawing import draw_files
from puckbench.figures.registry import FIGURES, figure_entry
from puckbench.figures.style import FigureStyle
from tests.support.figures_lookalike import gpcc_scales_table, thesis_medians_table
from tests.support.residuals_lookalike import residual_table, scan_table

OWN = [name for name in FIGURES.names() if FIGURES.module_of(name).startswith("jenco2022.")]


def draw(name: str, style: FigureStyle | None = None, **inputs: Any) -> Figure:
    style = style or FigureStyle()
    with style.context():
        figure: Figure = figure_entry(name).draw(**inputs, style=style)
    return figure


@pytest.fixture(scope="module")
def input_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("inputs")
    residuals = residual_table(50)
    distances = {"std_m": 0.01, "emd_m": 2e-3, "chance_m": 1e-3}
    tables = {
        "thesis_medians": thesis_medians_table(),
        "gpcc_scales": gpcc_scales_table(),
        "residuals": residuals,
        "scans": scan_table(50),
        "compared_residuals": residuals,
        "model_distances": pd.DataFrame({"model": ["real", "vlp16"], **distances}),
    }
    files = {name: folder / f"{name}.parquet" for name in tables}
    for name, table in tables.items():
        table.to_parquet(files[name])
    return files


@pytest.mark.parametrize("name", OWN)
def test_every_figure_is_drawn_from_files(
    name: str, input_files: dict[str, Path], tmp_path: Path
) -> None:
    draw_files(name, input_files, [tmp_path / "figure.png"], FigureStyle(dpi=30))
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_the_thesis_s_medians_lie_behind_ours() -> None:
    table = thesis_medians_table()
    panel = draw("beside_thesis", thesis_medians=table).axes[0]
    colour = FigureStyle().of_datasets(table["dataset"])["s3dis_noisy"].colour
    rows = table[(table["dataset"] == "s3dis_noisy") & (table["codec"] == "draco")]
    cd = rows[rows["quantity"] == "cd_plane"]
    drawn = [line for line in panel.get_lines() if line.get_color() == colour]
    wide, ours = sorted(drawn, key=lambda line: -line.get_linewidth())
    np.testing.assert_allclose(np.asarray(wide.get_ydata()), cd["thesis"])
    np.testing.assert_allclose(np.asarray(ours.get_ydata()), cd["here"])


def test_scales_that_are_no_power_of_two_have_small_markers() -> None:
    table = gpcc_scales_table()
    usual = FigureStyle().marker_size
    for axes in draw("gpcc_grid", gpcc_scales=table).axes:
        assert all(line.get_markerfacecolor() != "white" for line in axes.get_lines())
        small = [line for line in axes.get_lines() if line.get_markersize() < 0.7 * usual]
        drawn = {float(x) for line in small for x in np.asarray(line.get_xdata())}
        assert drawn == {0.375, 0.625, 0.75, 0.875}


@pytest.mark.parametrize(("name", "last"), [("gpcc_rounding", 3.0), ("gpcc_contexts", 1.1)])
def test_what_the_settings_as_run_cost_is_a_ratio_per_scale(name: str, last: float) -> None:
    axes = draw(name, gpcc_scales=gpcc_scales_table()).axes[0]
    first = axes.get_lines()[0]
    assert np.asarray(first.get_xdata())[-1] == 1.0
    assert np.asarray(first.get_ydata())[-1] == pytest.approx(last)


def test_without_the_settings_as_run_there_is_no_ratio_to_draw() -> None:
    table = gpcc_scales_table()
    with pytest.raises(InputError, match="no scale that both G-PCC codecs have"):
        draw("gpcc_rounding", gpcc_scales=table[table["codec"] == "gpcc"])


def test_legends_of_data_sets_are_within_the_page() -> None:
    table = gpcc_scales_table()
    titles = {name: f"{name} with a long title" for name in set(table["dataset"])}
    for name in ("gpcc_rounding", "gpcc_contexts"):
        for clouds in (3, 6):
            scales = table.assign(clouds=clouds)
            figure = draw(name, FigureStyle(dataset_titles=titles), gpcc_scales=scales)
            figure.draw_without_rendering()
            box, page = figure.legends[0].get_window_extent(), figure.bbox
            assert page.x0 <= box.x0 < box.x1 <= page.x1
            shown = [text.get_text() for text in figure.legends[0].get_texts()]
            shaded = any(drawn.get_paths() for drawn in figure.axes[0].collections)
            assert ("quartiles over clouds" in shown) == shaded == (clouds == 6)
