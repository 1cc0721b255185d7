"""Losses of tasks against closed forms of Student's t, and the bits that a task needs."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pointkit.errors import InputError
from puckbench.figures.perception import draw_perception
from puckbench.figures.style import FigureStyle
from puckbench.metrics.segmentation import WAYS
from puckbench.metrics.task_measures import TaskMeasure, with_margins
from puckbench.tables.perception_bits import bits_needed, perception_bits
from puckbench.tables.perception_losses import perception_losses
from puckbench.tables.segmentation_scores import segmentation_scores

BEFORE = np.array([60.0, 55, 70, 64, 58, 61])
NOISE = np.array([0.2, -0.1, 0.3, 0.0, -0.2, 0.1])
LOST = {"500mm": 20.0, "200mm": 0.9, "100mm": 0.3, "50mm": 0.3}
BITS = {"500mm": 1.0, "200mm": 2.0, "100mm": 3.0, "50mm": 4.0}
HIGHER = {
    "name": "seen", "title": "Seen", "column": "seen_percent", "undecoded": "seen_before_percent",
    "unit": "%", "better": "higher", "margin": 1.0,
}  # fmt: skip
LOWER = {
    "name": "missed", "title": "Missed", "column": "missed_m", "unit": "m", "better": "lower",
    "margin": 0.5,
}  # fmt: skip


def metrics(scenes: int = 6, seeds: int = 1) -> pd.DataFrame:
    """Scans whose result falls by `LOST` and noise that the seeds of a scene share."""
    rows: list[dict[str, Any]] = []
    for number in range(scenes):
        for seed in range(seeds):
            cloud = {"dataset": "streets", "cloud": f"s{number}-{seed}", "scene": f"s{number}"}
            for rate, lost in LOST.items():
                after = BEFORE[number] - lost - NOISE[number]
                values = {"seen_before_percent": BEFORE[number], "seen_percent": after}
                coded = {"codec": "puck", "rate": rate, "bpp": BITS[rate]}
                rows.append({**cloud, **coded, **values})
    return pd.DataFrame(rows)


def drives() -> pd.DataFrame:
    """Drives without coding in rows of their own, and decoded ones with and without times."""
    rows: list[dict[str, Any]] = []
    for number in range(6):
        drive = {"dataset": "ways", "cloud": f"d{number}"}
        rows += [
            {**drive, "codec": "undecoded", "rate": "times", "times": "kept", "missed_m": 1.0},
            {**drive, "codec": "undecoded", "rate": "no times", "times": "none", "missed_m": 9.0},
        ]
        coded = {**drive, "codec": "gpcc", "rate": "100mm", "bpp": 3.0}
        rows += [
            {**coded, "times": "none", "missed_m": 8.0},
            {**coded, "times": "azimuth", "missed_m": 1.25 + NOISE[number]},
        ]
    return pd.DataFrame(rows)


def losses(**tables: Any) -> pd.DataFrame:
    return perception_losses(**tables, measures=[HIGHER, LOWER], along_rays=["puck"])


@pytest.mark.parametrize("seeds", [1, 3])
def test_interval_is_that_of_the_scenes_paired_losses(seeds: int) -> None:
    row = losses(metrics=metrics(seeds=seeds)).set_index("rate").loc["200mm"]
    half = stats.t.ppf(0.975, 5) * NOISE.std(ddof=1) / 6**0.5
    mean = 0.9 + NOISE.mean()
    np.testing.assert_allclose(
        row[["loss", "low", "high"]].astype(float), [mean, mean - half, mean + half]
    )
    assert (row["scenes"], row["undecoded"], row["margin"]) == (6, BEFORE.mean(), 1.0)
    assert row["value"] == pytest.approx(BEFORE.mean() - mean)
    assert (row["task"], row["unit"], row["along_rays"]) == ("seen", "%", True)


def test_bits_are_those_from_which_on_no_rate_is_worse() -> None:
    table = losses(metrics=metrics())
    verdicts = table.set_index("rate")["verdict"].to_dict()
    assert verdicts["500mm"] == verdicts["200mm"] == "worse"
    assert verdicts["100mm"] == verdicts["50mm"] == "not worse"
    row = bits_needed(table).iloc[0]
    assert (row["bits"], row["rate"], row["verdict"]) == (3.0, "100mm", "not worse")
    assert row["most_bits"] == 4.0
    same = perception_bits(metrics=metrics(), measures=[HIGHER], along_rays=["puck"])
    assert same.iloc[0].to_dict() == row.to_dict()
    none = bits_needed(table[table["rate"] == "500mm"]).iloc[0]
    assert none["verdict"] == "no rate suffices"
    assert np.isnan(none["bits"])


def test_a_finer_rate_that_is_worse_leaves_no_coarser_one() -> None:
    table = losses(metrics=metrics())
    table.loc[table["rate"] == "50mm", "verdict"] = "worse"
    assert bits_needed(table).iloc[0]["verdict"] == "no rate suffices"


def test_drives_are_compared_with_their_own_row_and_the_best_times() -> None:
    (row,) = losses(metrics=metrics(), drives=drives())[-1:].to_dict("records")
    assert (row["task"], row["dataset"], row["along_rays"]) == ("missed", "ways", False)
    assert row["undecoded"] == 1.0
    assert row["loss"] == pytest.approx(0.25 + NOISE.mean())  # lower is better
    assert row["verdict"] == "not worse"


def test_few_scenes_allow_no_verdict() -> None:
    table = losses(metrics=metrics(scenes=5))
    assert set(table["verdict"]) == {"no verdict"}
    assert table["low"].isna().all()
    assert bits_needed(table).iloc[0]["verdict"] == "no verdict"


def test_a_scene_that_could_not_be_coded_leaves_no_verdict_on_the_others() -> None:
    whole = metrics()
    part = whole[~((whole["rate"] == "100mm") & (whole["scene"] == "s0"))]
    table = losses(metrics=part).set_index("rate")
    assert table.loc["100mm", ["scenes", "verdict"]].tolist() == [5, "no verdict"]


def test_sensors_are_those_of_the_clouds() -> None:
    clouds = pd.DataFrame({"dataset": ["streets"] * 2, "sensor": ["VLP-16", None]})
    assert set(losses(metrics=metrics(), clouds=clouds)["sensor"]) == {"VLP-16"}


def test_without_results_of_a_task_there_is_no_table() -> None:
    with pytest.raises(InputError, match="no results of a task"):
        losses(metrics=metrics().drop(columns="seen_percent"))


def test_margins_are_replaced_by_name() -> None:
    (measure,) = with_margins([TaskMeasure(**HIGHER)], {"seen": 2.5})
    assert measure.margin == 2.5
    with pytest.raises(InputError, match=r"no measure 'sen' \(known: seen\)"):
        with_margins([TaskMeasure(**HIGHER)], {"sen": 2.5})


def test_figure_tells_codecs_of_returns_and_of_points() -> None:
    figure = draw_perception(losses(metrics=metrics(), drives=drives()), FigureStyle())
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words[-2:] == ["margin", "95 % interval"]
    assert any(word.endswith("(returns)") for word in words)
    assert any(word.endswith("(points)") for word in words)
    titles = [axes.get_title().replace("\n", " ") for axes in figure.axes if axes.axison]
    assert titles == ["Streets (n = 6)", "Ways (n = 6)"]
    labels = [axes.get_ylabel() for axes in figure.axes if axes.axison]
    assert labels == ["Seen:\nloss (points)", "Missed:\nloss (m)"]


def test_scores_over_all_scans_are_those_of_added_counts() -> None:
    rows = []
    for cloud, counts in {"a": [[8, 2, 0], [0, 0, 0]], "b": [[0, 0, 0], [1, 3, 6]]}.items():
        same = {f"segmentation_{way}confusion": json.dumps(counts) for way in WAYS}
        about = {"dataset": "d", "cloud": cloud, "codec": "gpcc", "rate": "r", "bpp": 2.0}
        rows.append({**about, **same, "segmentation_classes": "low, high"})
    table = segmentation_scores(pd.DataFrame(rows))
    assert table["judged"].tolist() == ["coded", "without coding", "decoded", "holes"]
    row = table.iloc[0]
    assert row["miou_percent"] == pytest.approx(100 * (8 / 11 + 3 / 12) / 2)
    assert row["accuracy_percent"] == pytest.approx(55)
    assert (row["clouds"], row["iou_percent"]) == (2, "low 72.7, high 25.0")
