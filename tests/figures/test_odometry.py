"""The figure of odometry shows the error that the drives have."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest

from puckbench.core.errors import InputError
from puckbench.figures.odometry import draw_odometry
from puckbench.figures.style import FigureStyle

LONG, SHORT = {"ate_m": 0.2, "drift_percent": 2.0}, {"ate_m": 0.1, "drift_percent": None}


def drives(**errors: dict[str, float | None]) -> pd.DataFrame:
    """An undecoded drive and a codec at two rates, in each data set, with these errors."""
    rows: list[dict[str, Any]] = []
    for dataset, values in errors.items():
        common = {"dataset": dataset, "cloud": "a", "has_times": False, "lost_turns": 0, **values}
        rows.append({**common, "codec": "undecoded", "rate": "no times", "bpp": None})
        rows += [{**common, "codec": "draco", "rate": f"{n}mm", "bpp": 1.0 * n} for n in (1, 2)]
    return pd.DataFrame(rows).astype(dict.fromkeys(LONG, float))


@pytest.mark.parametrize(
    ("table", "label", "shown"),
    [
        (drives(a=LONG), "Drift (%)", {"A"}),
        (drives(a=LONG, b=SHORT), "Drift (%)", {"A"}),
        (drives(a=SHORT, b=SHORT), "Absolute error (m)", {"A", "B"}),
        (drives(a=SHORT).drop(columns="drift_percent"), "Absolute error (m)", {"A"}),
    ],
    ids=["long", "long_and_short", "short", "no_drift"],
)
def test_short_drives_have_their_absolute_error_where_none_has_a_drift(
    table: pd.DataFrame, label: str, shown: set[str]
) -> None:
    figure = draw_odometry(table, FigureStyle())
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    labels = [axes.get_ylabel() for axes in figure.axes] + [figure.get_supylabel(), *texts]
    assert any(each.startswith(label) for each in labels), labels
    titles = {axes.get_title().split(" ")[0].split("\n")[0] for axes in figure.axes}
    assert titles - {""} == shown


def test_without_any_complete_error_there_is_no_figure() -> None:
    table = drives(a=SHORT).assign(ate_m=[0.1, 0.1, None])
    with pytest.raises(InputError, match="no data set of which all drives have an error"):
        draw_odometry(table, FigureStyle())
