"""The table of what to store a sensor's data in, on rows made by hand."""

import numpy as np
import pandas as pd
import pytest

from pointkit.errors import InputError
from puckbench.metrics.coordinate_frames import rows_in_frame
from puckbench.metrics.interpolation import bits_at_error
from puckbench.tables.storage import storage


def _rows() -> pd.DataFrame:
    """Two clouds of a spin with two codecs, and a scaled cloud."""
    scaled = {"dataset": "objects", "cloud": "a", "codec": "draco", "rate": "r1", "bpp": 3.0}
    rows = [{**scaled, "d1_rms_m": 0.004}]
    # The error halves from rate to rate, each of which takes one bit more.
    table = (("10mm", 1, 8.0), ("5mm", 2, 4.0), ("2mm", 3, 0.0))
    for cloud, more in (("x", 1.0), ("y", 3.0)):
        for codec, factor in (("draco", 4.0), ("puck", 1.0)):
            rows += [
                {
                    "dataset": "spins",
                    "frame": "metric",
                    "cloud": cloud,
                    "codec": codec,
                    "rate": rate,
                    "bpp": factor * bits * more,
                    "d1_rms_m": error_mm / 1000,
                    "mbit_per_s": factor * bits * more / 10,
                    "encode_real_time": 10 / bits,
                    "decode_real_time": 20 / bits,
                }
                for rate, bits, error_mm in table
            ]
    return pd.DataFrame(rows)


def test_finest_rates_and_a_common_error() -> None:
    table = storage(_rows())
    assert list(table["codec"]) == ["puck", "draco"]  # fewest bits first
    assert set(table["dataset"]) == {"spins"}
    puck = table.iloc[0]
    assert puck["rate"] == "2mm"
    assert puck["bits_per_return"] == pytest.approx((3 + 9) / 2)
    assert puck["d1_rms_mm"] == 0
    assert puck["encode_real_time"] == pytest.approx(10 / 3)
    assert puck["clouds"] == 2
    # Between 8 mm for 1 bit and 4 mm for 2, in logarithms.
    share = (np.log(8) - np.log(5)) / np.log(2)
    assert puck["bits_at_5_mm"] == pytest.approx(2**share * (1 + 3) / 2)


def test_rates_of_different_errors_stand_apart() -> None:
    """The most bits are not the finest rate, and what loses more is not above what is exact."""
    rows = _rows().query("codec == 'puck'").assign(
        d2_rms_m=0.001, truth_d2_rms_m=0.009, q99_point_m=0.004, hausdorff_point_m=0.012,
        returns_added=3, encode_ms_per_turn=7.0,
    )  # fmt: skip
    grid = rows.assign(codec="laz", d1_rms_m=rows["d1_rms_m"] + 0.0005)
    coarse = rows.assign(codec="reno", bpp=rows["bpp"] / 100, d1_rms_m=0.002)
    coarse.loc[coarse["rate"] == "10mm", ["bpp", "d1_rms_m"]] = (99.0, 0.003)
    table = storage(pd.concat([rows, grid, coarse]))
    assert list(table["codec"]) == ["puck", "laz", "reno"]
    assert list(table["kept"]) == ["exact", "1 mm", "less"]
    assert table["rate"].iloc[2] == "5mm"  # of equal errors that of the fewest bits
    first = table.iloc[0]
    names = ["d2_rms_mm", "truth_d2_rms_mm", "q99_mm", "largest_mm"]
    assert first[names].tolist() == pytest.approx([1, 9, 4, 12])
    assert (first["returns_added"], first["encode_ms_per_turn"]) == (3, 7)


def test_bits_at_equal_d2_and_range_errors_stand_beside_those_at_equal_d1() -> None:
    """D2 is half of D1, so 5 mm lie between 16 and 8 mm of D1, and ranges are D1 itself."""
    rows = _rows().query("dataset == 'spins'")
    rows = rows.assign(d2_rms_m=rows["d1_rms_m"] * 0.5, range_rms_mm=1000 * rows["d1_rms_m"])
    rows[["d1_rms_m", "d2_rms_m"]] *= 2
    puck = storage(rows).iloc[0]
    share = (np.log(8) - np.log(5)) / np.log(2)
    expected = 2**share * (1 + 3) / 2
    names = ["bits_at_5_mm_d2", "bits_at_5_mm_range"]
    assert puck[names].tolist() == pytest.approx([expected] * 2)
    assert np.isnan(puck["bits_at_5_mm"])  # 8 mm is the least above 0


def test_an_error_that_no_rate_has_is_left_empty() -> None:
    rows = _rows()
    rows["d1_rms_m"] /= 10
    assert storage(rows)["bits_at_5_mm"].isna().all()


def test_small_errors_count_and_one_rate_has_nothing_between() -> None:
    bits, error_mm = pd.Series([1.0, 2.0, 4.0]), pd.Series([0.8, 0.2, 0.0])
    assert bits_at_error(bits, error_mm, 0.4) == pytest.approx(2**0.5)
    assert np.isnan(bits_at_error(bits[1:], error_mm[1:], 0.2))


def test_scaled_clouds_have_no_part_in_it() -> None:
    rows = _rows()
    assert len(rows_in_frame(rows, "scaled")) == 1
    assert len(rows_in_frame(rows, "metric")) == 12
    scaled = rows[rows["dataset"] == "objects"].drop(columns="frame")
    assert len(rows_in_frame(scaled, "scaled")) == 1
    with pytest.raises(InputError, match="no results of clouds in metres"):
        storage(scaled)
