"""Scans coloured by laser: the right surface, seen from the right side, in one colour per laser."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from pointkit.errors import InputError
from puckbench.figures.drawing import lay_out, save_figure
from puckbench.figures.registry import figure_entries, figure_entry
from puckbench.figures.style import FigureStyle
from tests.support.residuals_lookalike import ELEVATIONS, scan_table

FROM_SCANS = [name for name, entry in figure_entries().items() if entry.inputs == ("scans",)]


def draw(name: str, table: pd.DataFrame, style: FigureStyle | None = None) -> Figure:
    style = style or FigureStyle()
    with style.context():
        figure: Figure = figure_entry(name).draw(scans=table, style=style)
    return figure


def drawn_points(figure: Figure) -> np.ndarray:
    return np.asarray(figure.axes[0].collections[0].get_offsets())


@pytest.mark.parametrize("name", FROM_SCANS)
def test_every_figure_of_scans_is_drawn(name: str, tmp_path: Path) -> None:
    style = FigureStyle(dpi=30)
    figure = draw(name, scan_table(40), style)
    with style.context():
        lay_out(figure)
        save_figure(figure, tmp_path / "figure.png")
    assert "Laser elevation (\u00b0)" in [axes.get_ylabel() for axes in figure.axes]


def test_the_wall_is_seen_from_the_front_and_the_floor_from_above() -> None:
    table = scan_table(50)
    far = table[(table["distance_m"] == 5) & (table["model"] == "vlp16_divergence")]
    for name, surface, columns in (
        ("fig_5_4", "wall", ["x_m", "z_m"]),
        ("fig_5_5", "floor", ["y_m", "x_m"]),
    ):
        expected = far.loc[far["surface"] == surface, columns].to_numpy()
        np.testing.assert_array_equal(drawn_points(draw(name, table)), expected)


def test_a_capture_comes_before_the_virtual_sensor_and_is_named() -> None:
    table = scan_table(50)
    real = table[table["model"] == "vlp16"].assign(model="real")
    assert draw("fig_5_4", table).axes[0].get_title() == "Virtual (Beam divergence)"
    figure = draw("fig_5_4", pd.concat([table, real]))
    assert figure.axes[0].get_title() == "Real VLP-16"


def test_each_laser_has_one_colour_of_its_own() -> None:
    table = scan_table(300)
    colours = draw("fig_5_6", table).axes[0].collections[0].get_facecolors()
    assert len(np.unique(colours, axis=0)) == len(ELEVATIONS)
    alone = draw("fig_5_7", table).axes[0].collections[0].get_facecolors()
    assert len(np.unique(alone, axis=0)) == 1
    assert alone[0].tolist() in np.unique(colours, axis=0).tolist()


def test_models_stand_side_by_side_in_the_thesis_s_order() -> None:
    titles = [axes.get_title() for axes in draw("fig_5_17", scan_table(20)).axes[:-1]]
    assert titles == ["No noise", "HDL-64E", "VLP-16", "Beam divergence", "Incidence"]
    others = draw("fig_5_17", scan_table(20).assign(model="my_model")).axes[:-1]
    assert [axes.get_title() for axes in others] == ["My model"]


def test_a_scan_that_is_not_there_is_named() -> None:
    table = scan_table(10)
    with pytest.raises(InputError, match="scan table: no wall at 5 m"):
        draw("fig_5_4", table[table["distance_m"] == 1])
    with pytest.raises(InputError, match="scan table: no column 'laser_id'"):
        draw("fig_5_4", table.drop(columns="laser_id"))
