"""The table of bits against G-PCC's octree, on curves of which bits are known everywhere."""

import numpy as np
import pandas as pd
import pytest

from pointkit.errors import InputError
from puckbench.tables.against_octree import against_octree


def _rows() -> pd.DataFrame:
    """Bits fall as a power of the error, so that they are known between rates."""
    curves = {
        "gpcc": (40.0, (50, 10, 1, 0.5)),
        "gpcc_angular": (30.0, (50, 10, 1, 0.5)),
        "coarse": (20.0, (50, 12)),  # never as near as 5 mm
    }
    rows = [
        {"codec": codec, "bpp": share * factor / np.sqrt(mm), "error": mm, "cloud": cloud}
        for codec, (factor, errors) in curves.items()
        for mm in errors
        for cloud, share in (("a", 1.0), ("b", 1.2))
    ]
    rows += [{"codec": "exact", "bpp": 6.0, "error": 0.0, "cloud": cloud} for cloud in "ab"]
    table = pd.DataFrame(rows)
    table["d1_rms_m"] = table.pop("error") / 1000
    return table.assign(dataset="spins", frame="metric", rate="r", points_in=1000, points_out=1000)


def test_bits_are_compared_where_both_curves_reach() -> None:
    table = against_octree(_rows()).set_index("codec")
    octree, angular = table.loc["gpcc"], table.loc["gpcc_angular"]
    for error in (20, 10, 5):
        assert octree[f"at_{error}_mm"] == pytest.approx(1.1 * 40 / np.sqrt(error))
        assert angular[f"saved_at_{error}_mm"] == pytest.approx(25)
    assert octree["saved_at_5_mm"] == 0
    assert octree["grid_1_mm"] == pytest.approx(1.1 * 40 / np.sqrt(0.5))
    assert octree["grid_2_mm"] == pytest.approx(1.1 * 40)
    coarse = table.loc["coarse"]
    assert coarse["saved_at_20_mm"] == pytest.approx(50)
    assert coarse[["at_10_mm", "at_5_mm", "grid_2_mm", "grid_1_mm"]].isna().all()
    assert (coarse["coarsest_mm"], coarse["finest_mm"]) == pytest.approx((50, 12))


def test_what_is_exact_is_on_every_grid_and_at_no_error() -> None:
    exact = against_octree(_rows()).set_index("codec").loc["exact"]
    assert exact["grid_2_mm"] == exact["grid_1_mm"] == 6
    assert exact["saved_grid_1_mm"] == pytest.approx(100 * (1 - 6 / (1.1 * 40 / np.sqrt(0.5))))
    assert np.isnan(exact["at_5_mm"])


def test_what_drops_points_is_not_without_loss() -> None:
    rows = _rows()
    merged = (rows["codec"] == "gpcc_angular") & (rows["d1_rms_m"] == 0.001)
    rows.loc[merged, "points_out"] = 999
    angular = against_octree(rows).set_index("codec").loc["gpcc_angular"]
    fewest = 1.1 * 30 / np.sqrt(0.5)  # the next rate, of 0.5 mm
    assert angular["grid_2_mm"] == angular["grid_1_mm"] == pytest.approx(fewest)
    assert angular["at_5_mm"] == pytest.approx(1.1 * 30 / np.sqrt(5))


def test_bits_without_loss_are_against_the_octree_that_keeps_every_point() -> None:
    rows = _rows()
    octree = rows[rows["codec"] == "gpcc"]
    complete = octree.assign(codec="gpcc_lossless", bpp=1.25 * octree["bpp"])
    rows.loc[rows["codec"] == "gpcc", "points_out"] = 990
    table = against_octree(pd.concat([rows, complete])).set_index("codec")
    assert table.loc["gpcc", ["grid_2_mm", "grid_1_mm"]].isna().all()
    assert table.loc["gpcc_angular", "saved_grid_1_mm"] == pytest.approx(100 * (1 - 30 / 50))
    assert table.loc["gpcc_lossless", "saved_grid_1_mm"] == 0
    assert table.loc["gpcc_lossless", "saved_at_5_mm"] == pytest.approx(-25)
    assert table.loc["gpcc_angular", "saved_at_5_mm"] == pytest.approx(25)


def test_without_the_octree_nothing_is_saved() -> None:
    rows = _rows()
    table = against_octree(rows[rows["codec"] != "gpcc"])
    assert table["saved_grid_1_mm"].isna().all()
    assert table["grid_1_mm"].notna().sum() == 2
    with pytest.raises(InputError, match="no results of clouds in metres"):
        against_octree(rows.assign(frame="scaled"))
