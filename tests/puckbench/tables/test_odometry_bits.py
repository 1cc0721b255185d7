"""Non-inferiority of odometry against closed forms of Student's t."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pointkit.errors import InputError
from puckbench.recordings.drives import UNDECODED_POSES
from puckbench.tables.odometry_bits import odometry_bits
from puckbench.tables.odometry_differences import ALL, odometry_differences

BEFORE = np.array([0.3, 0.5, 0.4, 0.9, 0.6, 0.3])
NOISE = np.array([0.02, -0.01, 0.03, 0.0, -0.02, 0.01])
ADDED = {"500mm": 5.0, "200mm": 0.3, "100mm": 0.02}
BITS = {"500mm": 0.5, "200mm": 1.5, "100mm": 3.0}


def drives(
    dataset: str = "way", count: int = 6, column: str = "drift_percent", scale: float = 1.0
) -> pd.DataFrame:
    """Undecoded drives, and a codec whose error is larger by `ADDED`, with times and without."""
    rows: list[dict[str, Any]] = []
    for number in range(count):
        about = {
            "dataset": dataset,
            "cloud": f"{dataset}_{number}-1",
            "scene": f"{dataset}_{number}",
        }
        common = {**about, "poses": "true", "lost_turns": 0, "turns": 70}
        values = {"times": (BEFORE, "kept"), "no times": (BEFORE + 2, "none")}
        for rate, (before, times) in values.items():
            row = {**common, "codec": "undecoded", "rate": rate, "times": times}
            rows.append({**row, column: scale * before[number]})
        for rate, added in ADDED.items():
            error = BEFORE[number] + added + NOISE[number]
            for times, more in {"azimuth": 0.0, "none": 2.0}.items():
                row = {**common, "codec": "gpcc", "rate": rate, "times": times, "bpp": BITS[rate]}
                rows.append({**row, column: scale * (error + more)})
    return pd.DataFrame(rows)


def test_interval_is_that_of_the_trajectories_differences() -> None:
    table = odometry_differences(drives())
    row = table[(table["rate"] == "200mm") & (table["times"] == "azimuth")].iloc[0]
    half = stats.t.ppf(0.975, 5) * NOISE.std(ddof=1) / 6**0.5
    mean = 0.3 + NOISE.mean()
    np.testing.assert_allclose(
        row[["difference", "low", "high"]].astype(float), [mean, mean - half, mean + half]
    )
    assert (row["undecoded"], row["margin"], row["trajectories"]) == (BEFORE.mean(), 0.1, 6)
    verdicts = table[table["times"] == "azimuth"].set_index("rate")["verdict"].to_dict()
    assert verdicts == {"500mm": "worse", "200mm": "worse", "100mm": "not worse"}
    untimed = table[table["codec"] == "undecoded"].iloc[0]
    assert (untimed["times"], untimed["difference"]) == ("none", pytest.approx(2.0))
    assert (table["measure"] == "drift").all()


def test_bits_are_those_from_which_on_no_rate_is_worse_with_the_same_baseline() -> None:
    table = odometry_bits(drives()).set_index("times")
    assert table.loc["azimuth", ["rate", "bits", "verdict"]].tolist() == ["100mm", 3.0, "not worse"]
    assert table.loc["none", "verdict"] == "no rate suffices"
    assert np.isnan(table.loc["none", "bits"])
    assert table["undecoded"].nunique() == 1


def test_fewer_than_six_trajectories_allow_no_verdict() -> None:
    for count in (1, 5):
        table = odometry_bits(drives(count=count))
        assert set(table["verdict"]) == {"no verdict"}
        assert table["bits"].isna().all()
        assert odometry_differences(drives(count=count))["low"].isna().all()


def test_margin_is_absolute_where_the_reference_is_the_undecoded_trajectory() -> None:
    """Its own error is nothing, and a tenth of nothing would allow nothing."""
    table = drives()
    undecoded = (table["codec"] == "undecoded") & (table["times"] == "kept")
    small = table.assign(drift_percent=table["drift_percent"].where(~undecoded, 6.5e-8))
    coded = small["codec"] == "gpcc"
    small.loc[coded, "drift_percent"] -= np.repeat(BEFORE, 6)
    rows = odometry_bits(small).set_index("times")
    assert rows.loc["azimuth", "rate"] == "100mm"
    assert rows.loc["azimuth", "undecoded"] == pytest.approx(6.5e-8)


def deviations(count: int) -> pd.DataFrame:
    """Drives without true poses: those of odometry on the undecoded turns replace them."""
    table = drives(count=count).assign(poses=UNDECODED_POSES)
    is_reference = (table["codec"] == "undecoded") & (table["times"] == "kept")
    table["drift_percent"] -= table["cloud"].map(lambda name: BEFORE[int(name[4])])
    return table.assign(drift_percent=table["drift_percent"].where(~is_reference, 6e-8))


def test_deviations_from_odometry_have_a_wider_margin() -> None:
    """At 200 mm they are 0.3 %: above the margin of errors, below that of deviations."""
    table = odometry_bits(deviations(6)).set_index("times")
    assert table.loc["azimuth", ["rate", "margin"]].tolist() == ["200mm", 0.5]
    narrow = odometry_bits(deviations(6), {"deviation_drift_percent": 0.1}).set_index("times")
    assert narrow.loc["azimuth", ["rate", "margin"]].tolist() == ["100mm", 0.1]
    known = odometry_bits(drives(), {"deviation_drift_percent": 5.0}).set_index("times")
    assert known.loc["azimuth", ["rate", "margin"]].tolist() == ["100mm", 0.1]


@pytest.mark.parametrize("count", [1, 5])
def test_a_few_deviations_are_judged_by_the_greatest(count: int) -> None:
    table = deviations(count)
    bits = odometry_bits(table).set_index("times")
    assert bits.loc["azimuth", ["rate", "verdict"]].tolist() == ["200mm", "within the margin"]
    assert bits.loc["none", "verdict"] == "no rate suffices"
    one = (table["cloud"] == "way_0-1") & (table["rate"] == "200mm") & (table["times"] == "azimuth")
    table.loc[one, "drift_percent"] = 0.6
    bits = odometry_bits(table).set_index("times")
    assert bits.loc["azimuth", "rate"] == "100mm"


def test_short_drives_have_their_absolute_error_in_millimetres() -> None:
    table = odometry_differences(drives(column="ate_m", scale=0.1))
    assert set(table["unit"]) == {"mm"}
    row = table[(table["rate"] == "100mm") & (table["times"] == "azimuth")].iloc[0]
    assert row["undecoded"] == pytest.approx(100 * BEFORE.mean())
    assert row["margin"] == 10.0


def test_trajectories_of_all_data_sets_with_a_drift_are_pooled() -> None:
    rooms = drives("rooms", column="ate_m", scale=0.1)
    table = odometry_differences(pd.concat([drives("a"), drives("b"), rooms]))
    pooled = table[table["dataset"] == ALL]
    assert set(pooled["trajectories"]) == {12}
    assert set(pooled["measure"]) == {"drift"}


def test_gicp_is_beside_kiss_icp() -> None:
    both = drives()
    both = both.assign(gicp_drift_percent=both["drift_percent"] * 2, gicp_lost_turns=1)
    table = odometry_differences(both).set_index(["odometry", "codec", "times", "rate"])
    row = table.loc[("GICP", "gpcc", "azimuth", "100mm")]
    assert row["value"] == pytest.approx(2 * (BEFORE + 0.02 + NOISE).mean())
    assert row["lost_turns"] == 6


def test_without_undecoded_drives_there_is_no_table() -> None:
    table = drives()
    with pytest.raises(InputError, match="no result of an undecoded drive"):
        odometry_differences(table[table["codec"] == "gpcc"])
    with pytest.raises(InputError, match="no codec's results"):
        odometry_bits(table[table["codec"] == "undecoded"])
