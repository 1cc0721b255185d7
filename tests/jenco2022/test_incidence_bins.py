import numpy as np
import pandas as pd
import pytest

from jenco2022.tables.incidence_effect import incidence_bins
from pointkit.errors import InputError


def small_table() -> pd.DataFrame:
    """Residuals 1, 2, .. 5, 10 and 20 at rising angles."""
    return pd.DataFrame(
        {
            "model": pd.Categorical(["vlp16"] * 7, categories=["vlp16", "unused"]),
            "residual_m": np.array([1, 2, 3, 4, 5, 10, 20], dtype=np.float32),
            "incidence_rad": np.array([0, 0.1, 0.4, 0.5, 0.6, 0.9, 1.0], dtype=np.float32),
        }
    )


def test_incidence_bins_by_hand() -> None:
    bins = incidence_bins(small_table(), bins=4, highest_rad=1.0)
    assert bins["low_rad"].tolist() == pytest.approx([0, 0.25, 0.5, 0.75])
    assert bins["high_rad"].tolist() == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert bins["count"].tolist() == [2, 1, 2, 2]
    assert bins["mean_m"].tolist() == [1.5, 3, 4.5, 15]
    assert bins["std_m"].tolist()[3] == pytest.approx(np.sqrt(50))


def test_incidence_bins_end_where_told_and_leave_out_empty_ones() -> None:
    bins = incidence_bins(small_table(), bins=3, highest_rad=0.45)
    assert bins["model"].tolist() == ["vlp16", "vlp16"]
    assert bins["low_rad"].tolist() == pytest.approx([0, 0.3])
    assert bins["count"].tolist() == [2, 1]


def test_empty_samples_are_refused() -> None:
    with pytest.raises(InputError, match="at least one residual"):
        incidence_bins(small_table().iloc[:0])
