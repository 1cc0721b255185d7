"""Statistics of residuals: moments by hand, and intervals that hold what they promise."""

import numpy as np
import pandas as pd
import pytest

from jenco2022.tables.residual_statistics import residual_statistics
from pointkit.errors import InputError
from pointkit.seeding import generator


def table_of(rows: list[tuple[str, str, float, int, int, float]]) -> pd.DataFrame:
    names = ["model", "surface", "distance_m", "run", "laser_id", "residual_m"]
    return pd.DataFrame(rows, columns=names)


def row_of(statistics: pd.DataFrame, *keys: str) -> pd.Series:
    names = ("model", "surface", "distance_m", "laser_id")
    result = statistics[
        np.all([statistics[name] == key for name, key in zip(names, keys, strict=True)], axis=0)
    ]
    assert len(result) == 1
    return result.iloc[0]


def test_moments_by_hand_and_of_all_together() -> None:
    rows = [("vlp16", "wall", 1.0, 1, 0, value) for value in (1.0, 2.0, 6.0)]
    rows += [("vlp16", "floor", 1.0, 1, 3, -1.0), ("vlp16", "floor", 30.0, 1, 3, 50.0)]
    result = residual_statistics(table_of(rows))
    wall = row_of(result, "vlp16", "wall", "1", "0")
    assert (wall["count"], wall["scans"], wall["median_m"]) == (3, 1, 2)
    assert [wall["mean_m"], wall["std_m"]] == pytest.approx([3, np.sqrt(7)])
    assert wall["rms_m"] == pytest.approx(np.sqrt(41 / 3))
    near = row_of(result, "vlp16", "all", "all", "all")
    assert (near["count"], near["mean_m"]) == (4, 2)  # what is 30 m away is not in it
    assert row_of(result, "vlp16", "all", "30", "3")["mean_m"] == 50
    # Every set of keys: 3 of (surface, distance), and of them together, twice for the laser.
    assert not result.duplicated(["model", "surface", "distance_m", "laser_id"]).any()


def test_rows_come_by_surface_distance_and_laser_with_all_last() -> None:
    rows = [
        ("b", surface, distance, 1, laser, 0.0)
        for surface in ("ceiling", "floor", "wall")
        for distance in (2.0, 1.0)
        for laser in (10, 9)
    ]
    result = residual_statistics(table_of(rows))
    assert list(dict.fromkeys(result["surface"])) == ["wall", "floor", "ceiling", "all"]
    wall = result[result["surface"] == "wall"]
    assert list(dict.fromkeys(wall["distance_m"])) == ["1", "2", "all"]
    assert wall["laser_id"].tolist()[:3] == ["9", "10", "all"]


def test_half_widths_of_two_scans_by_hand() -> None:
    rows = [("m", "wall", 1.0, run, 0, value) for run, value in ((1, 0.0), (1, 2.0), (2, 5.0))]
    result = row_of(residual_statistics(table_of(rows)), "m", "wall", "1", "0")
    # Mean 7/3; the scans are off by -8/3 and 8/3 in sum, so by 16/3 between them.
    standard_error = np.sqrt(2 * 2 * (8 / 3) ** 2) / 3
    assert result["mean_half_m"] == pytest.approx(12.7062 * standard_error, rel=1e-5)


def test_scans_that_were_not_repeated_have_no_interval() -> None:
    rows = [("m", "wall", distance, 1, 0, value) for distance in (1.0, 2.0) for value in (0.0, 1.0)]
    result = residual_statistics(table_of(rows))
    assert result[["mean_half_m", "std_half_m"]].isna().all(axis=None)


def repetitions(times: int) -> pd.DataFrame:
    """A model each: two surfaces of different noise at two distances, four runs.

    All returns of a scan share an error of their own.
    """
    axes = np.indices((times, 2, 2, 4, 80)).reshape(5, -1)
    rng = generator(3, "coverage")
    shared = np.repeat(rng.normal(size=times * 16), 80)
    noise = np.where(axes[1] == 0, 1.0, 3.0)
    return pd.DataFrame(
        {
            "model": axes[0].astype(str),
            "surface": np.where(axes[1] == 0, "wall", "floor"),
            "distance_m": axes[2] + 1.0,
            "run": axes[3],
            "laser_id": 0,
            "residual_m": noise * (0.4 * shared + rng.normal(size=shared.size)),
        }
    )


def test_intervals_of_the_mean_and_the_spread_hold_the_truth() -> None:
    result = residual_statistics(repetitions(300))
    whole = result[(result[["surface", "distance_m", "laser_id"]] == "all").all(axis=1)]
    assert len(whole) == 300
    spread = np.sqrt(1.16 * (1 + 9) / 2)
    means = (whole["mean_m"].abs() < whole["mean_half_m"]).sum()
    spreads = ((whole["std_m"] - spread).abs() < whole["std_half_m"]).sum()
    # 95 % of 300 are 285; less than 270 or more than 297 of them is no accident.
    assert 270 <= means <= 297
    assert 270 <= spreads <= 297


def test_a_table_without_rows_is_refused() -> None:
    with pytest.raises(InputError, match="at least one residual"):
        residual_statistics(table_of([]))
