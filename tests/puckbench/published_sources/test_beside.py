"""Curves of a run beside published ones: each difference of conditions is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from puckbench.published_sources.beside import (
    HERE,
    beside_published,
    bits_at_equal_quality,
    curves_of,
    marks_of,
)
from puckbench.published_sources.registry import source_named
from tests.support.published_lookalike import published_rows, write_source
from tests.support.reference_lookalike import CLOUDS, MINE, clouds_of, rows_of


@pytest.fixture
def beside(tmp_path: Path) -> Any:
    """What compares results of a run with the rows of a source."""

    def compared(rows: list[dict[str, str]], metrics: pd.DataFrame) -> pd.DataFrame:
        source = source_named(str(write_source(tmp_path / "theirs.csv", rows)))
        return beside_published(metrics, clouds_of(CLOUDS), {"objects": "Things 1"}, [source])

    return compared


def test_equal_conditions_have_no_mark_and_the_known_ratio(beside: Any) -> None:
    points = beside(published_rows("Net", 1.25), rows_of("mine", MINE))
    assert marks_of(points) == {}
    deltas = bits_at_equal_quality(points)
    assert len(deltas) == 2
    assert deltas["bd_rate_percent"].to_numpy() == pytest.approx(100 * (1 / 1.25 - 1), abs=1e-3)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"peak": "2047"}, "peak 2047 (here 1023)"),
        ({"peak": "1023 m"}, "peak 1023 m (here 1023)"),
        ({"peak": "not stated"}, "peak not stated (here 1023)"),
        ({"points": "9000"}, "points 9,000 (here 8,000)"),
        ({"points": "not stated"}, "points not stated (here 8,000)"),
        ({"frames": "110"}, "frames 110 (here 4)"),
        ({"resolution": "1 mm"}, "coordinates 1 mm (here cube [0, 1023])"),
        (
            {"peak": "30 m", "frames": "1", "resolution": "2 cm"},
            "peak 30 m (here 1023); frames 1 (here 4); coordinates 2 cm (here cube [0, 1023])",
        ),
    ],
)
def test_each_difference_of_conditions_is_named(
    changed: dict[str, str], told: str, beside: Any
) -> None:
    points = beside(published_rows("Net", 1.25, **changed), rows_of("mine", MINE))
    assert marks_of(points) == {told: "[1]"}
    assert set(points.loc[points["origin"] == "theirs", "differs"]) == {told}
    assert set(points.loc[points["origin"] == HERE, "differs"]) == {""}
    deltas = bits_at_equal_quality(points)
    assert set(deltas["differs"]) == {told}
    reasons = {"peak": "another peak", "points": "other points"}
    reason = next((reasons[name] for name in changed if name in reasons), "compared")
    assert set(deltas["bd_rate_status"]) == {reason}
    assert deltas["bd_rate_percent"].isna().all() == (reason != "compared")


def test_times_of_another_machine_and_another_version_are_named(beside: Any) -> None:
    metrics = rows_of("gpcc", MINE).assign(cpu="Xeon", encode_cpu="Xeon")
    times = [
        {**row, "measure": "encode_s", "value": "2", "peak": "none", "machine": "a GPU"}
        for row in published_rows("G-PCC octree", 1.0)[:5]
    ]
    told = "version v7 (here gpcc 1); machine a GPU (here Xeon)"
    assert list(marks_of(beside(times, metrics))) == [told]
    same = [{**row, "machine": "Xeon", "codec": "Net"} for row in times]
    assert marks_of(beside(same, metrics)) == {}
    unknown = [{**row, "machine": "not stated"} for row in same]
    told = "machine not stated (here not stated)"
    assert list(marks_of(beside(unknown, rows_of("gpcc", MINE)))) == [told]


def test_no_line_joins_unequal_conditions(beside: Any) -> None:
    """A curve whose last rates are of other clouds is two."""
    rows = published_rows("Net", 1.25)
    for row in rows:
        row["points"] = "8000" if row["rate"] < "R4" else "20000"
    points = beside(rows, rows_of("mine", MINE))
    found = [(curve["origin"], curve["differs"], len(rows)) for curve, rows in curves_of(points)]
    told = "points 20,000 (here 8,000)"
    of_metric = [("this run", "", 5), ("theirs", "", 3), ("theirs", told, 2)]
    assert sorted(found) == sorted(2 * of_metric)


def test_a_published_cloud_is_beside_the_one_of_its_name(beside: Any) -> None:
    """The bits of thing_1 are 2, and the mean is 2.5, times those of the first."""
    rows = [{**row, "cloud": "thing_1"} for row in published_rows("Net", 1.0, frames="1")]
    points = beside(rows, rows_of("mine", MINE))
    assert marks_of(points) == {}
    percent = bits_at_equal_quality(points)["bd_rate_percent"].to_numpy()
    assert percent == pytest.approx(100 * (2 / 2.5 - 1), abs=1e-3)
    others = [{**row, "cloud": "bunny"} for row in rows]
    points = beside(others, rows_of("mine", MINE))
    told = "cloud bunny (here mean of the run's); frames 1 (here 4)"
    assert list(marks_of(points)) == [told]
    assert set(bits_at_equal_quality(points)["bd_rate_status"]) == {"another cloud"}


def test_medians_are_beside_medians(beside: Any) -> None:
    rows = [{**row, "cloud": "median"} for row in published_rows("Net", 1.0)]
    points = beside(rows, rows_of("mine", MINE))
    own = points[points["origin"].eq(HERE) & points["metric"].eq("d1_psnr")]
    median = rows_of("mine", MINE).groupby("rate")["bpp"].median()
    assert dict(zip(own["rate"], own["bpp"], strict=True)) == pytest.approx(median.to_dict())
    assert set(own["cloud"]) == {"median"}


def test_lossless_rates_are_infinite_and_of_all_clouds(beside: Any) -> None:
    own = rows_of("mine", MINE)
    is_best = own["rate"].eq("r5") | (own["rate"].eq("r4") & own["cloud"].eq("thing_0"))
    own = own.assign(lossless=is_best, d1_psnr=own["d1_psnr"].mask(is_best))
    points = beside(published_rows("Net", 1.0), own)
    chosen = points[points["origin"].eq(HERE) & points["metric"].eq("d1_psnr")]
    values = dict(zip(chosen["rate"], chosen["measured"], strict=True))
    assert values == {"r1": 46, "r2": 52, "r3": 58, "r5": np.inf}


def test_colours_are_beside_colours_with_their_own_bits(beside: Any) -> None:
    own = rows_of("mine", MINE)
    own = own.assign(y_psnr=own["d1_psnr"] - 10, bpp_colour=own["bpp"], bpp=3 * own["bpp"])
    rows = [{**row, "measure": "y_psnr", "peak": "1"} for row in published_rows("Net", 1.25)[:5]]
    for row in rows:
        row["value"] = str(float(row["value"]) - 10)
    points = beside(rows, own)
    assert marks_of(points) == {}
    percent = bits_at_equal_quality(points)["bd_rate_percent"].to_numpy()
    assert percent == pytest.approx(100 * (1 / 1.25 - 1), abs=1e-3)


def test_a_rate_that_some_clouds_lack_is_on_no_curve(beside: Any) -> None:
    own = rows_of("mine", MINE)
    own = own[~(own["rate"].eq("r2") & own["cloud"].eq("thing_3"))]
    points = beside(published_rows("Net", 1.0), own)
    chosen = points[points["origin"].eq(HERE) & points["metric"].eq("d1_psnr")]
    assert chosen["rate"].tolist() == ["r1", "r3", "r4", "r5"]
