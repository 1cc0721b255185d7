import numpy as np
import pandas as pd
import pytest

from puckbench.core.errors import InputError
from puckbench.thesis.residuals.grouped_statistics import grouped_statistics, incidence_bins


def small_table() -> pd.DataFrame:
    """Residuals 1, 2, .. 5 of laser 0 on a wall, and 10, 20 of laser 1 on a floor."""
    return pd.DataFrame(
        {
            "model": pd.Categorical(["vlp16"] * 7, categories=["vlp16", "unused"]),
            "surface": ["wall"] * 5 + ["floor"] * 2,
            "distance_m": np.float32(1),
            "laser_id": [0] * 5 + [1] * 2,
            "residual_m": np.array([1, 2, 3, 4, 5, 10, 20], dtype=np.float32),
            "incidence_rad": np.array([0, 0.1, 0.4, 0.5, 0.6, 0.9, 1.0], dtype=np.float32),
        }
    )


def test_statistics_per_laser_by_hand() -> None:
    floor, wall = grouped_statistics(small_table()).to_dict("records")
    assert (wall["surface"], wall["laser_id"], wall["count"]) == ("wall", 0, 5)
    assert wall["mean_m"] == 3
    assert wall["std_m"] == pytest.approx(np.sqrt(2.5))
    names = ("q05_m", "q25_m", "q50_m", "q75_m", "q95_m")
    assert [wall[name] for name in names] == pytest.approx([1.2, 2, 3, 4, 4.8])
    assert (floor["surface"], floor["mean_m"], floor["q50_m"]) == ("floor", 15, 15)


def test_incidence_bins_by_hand() -> None:
    bins = incidence_bins(small_table(), bins=4)
    assert bins["low_rad"].tolist() == pytest.approx([0, 0.25, 0.5, 0.75])
    assert bins["high_rad"].tolist() == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert bins["count"].tolist() == [2, 1, 2, 2]
    assert bins["mean_m"].tolist() == [1.5, 3, 4.5, 15]
    assert bins["std_m"].tolist()[3] == pytest.approx(np.sqrt(50))


def test_incidence_bins_end_where_told_and_leave_out_empty_ones() -> None:
    bins = incidence_bins(small_table(), bins=3, by=("surface",), highest_rad=0.45)
    assert bins["surface"].tolist() == ["wall", "wall"]
    assert bins["low_rad"].tolist() == pytest.approx([0, 0.3])
    assert bins["count"].tolist() == [2, 1]


def test_empty_samples_are_refused() -> None:
    with pytest.raises(InputError, match="at least one residual"):
        incidence_bins(small_table().iloc[:0])
