"""The figure of odometry shows the measure that the drives have, and says what is drawn."""

from __future__ import annotations

import pandas as pd
import pytest

from pointkit.errors import InputError
from puckbench.figures.odometry import draw_odometry
from puckbench.figures.style import FigureStyle
from puckbench.tables.odometry_differences import odometry_differences
from tests.puckbench.tables.test_odometry_bits import drives

LONG = drives("a")
SHORT = drives("b", column="ate_m", scale=0.1)


@pytest.mark.parametrize(
    ("table", "labels"),
    [
        (LONG, {"A (n = 6), KISS-ICP": "Drift added (%)"}),
        (SHORT, {"B (n = 6), KISS-ICP": "Error added (mm)"}),
        (
            pd.concat([LONG, SHORT]),
            {"A (n = 6), KISS-ICP": "Drift added (", "B (n = 6), KISS-ICP": "Error added (mm)"},
        ),
        (drives("a", count=1), {"A (n = 1), KISS-ICP": "Drift added ("}),
    ],
    ids=["long", "short", "both", "one"],
)
def test_each_panel_has_the_measure_of_its_drives(
    table: pd.DataFrame, labels: dict[str, str]
) -> None:
    figure = draw_odometry(odometry_differences(table), FigureStyle())
    shown = {axes.get_title().replace("\n", " "): axes.get_ylabel() for axes in figure.axes}
    assert shown.keys() == labels.keys()
    assert all(shown[title].startswith(label) for title, label in labels.items())


def test_legend_names_codecs_times_margin_and_lost_turns() -> None:
    table = LONG.assign(lost_turns=(LONG["rate"] == "500mm").astype(int))
    figure = draw_odometry(odometry_differences(table), FigureStyle())
    (legend,) = figure.legends
    words = {text.get_text() for text in legend.get_texts()}
    assert {"margin", "95 % interval", "turns lost", "undecoded, no times"} < words
    assert len(words) == 6  # the codec with times from azimuths, and without


def test_two_odometries_are_two_rows() -> None:
    both = LONG.assign(gicp_drift_percent=LONG["drift_percent"], gicp_lost_turns=0)
    figure = draw_odometry(odometry_differences(both), FigureStyle())
    titles = [axes.get_title().replace("\n", " ") for axes in figure.axes]
    assert titles == ["A (n = 6), KISS-ICP", "A (n = 6), GICP"]


def test_without_any_complete_error_there_is_no_figure() -> None:
    table = SHORT.assign(ate_m=None)
    with pytest.raises(InputError, match="no results of odometry"):
        draw_odometry(odometry_differences(table), FigureStyle())
