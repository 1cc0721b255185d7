"""The table of the distances to the true surface, on curves made by hand."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pointkit.errors import InputError
from puckbench.metrics.interpolation import bits_to_reach
from puckbench.tables.nearest_truth import nearest_truth, truth_bits

SCALE = 100.0  # units per metre: 1 unit² is 10 mm squared
SCAN_MM = {"a": 10.0, "b": 20.0, "c": 40.0, "d": 20.0}
BITS = (1.0, 4.0, 16.0)


def _units(millimetres: float) -> float:
    return (millimetres / 1000 * SCALE) ** 2


def _rows(
    of_scan: dict[str, tuple[float, ...]], scan_mm: dict[str, float] = SCAN_MM
) -> pd.DataFrame:
    """Curves whose distances are fractions of the scan's own, for two seeds of each scene."""
    return pd.DataFrame(
        {
            "dataset": "rooms", "cloud": f"{scene}-{seed}", "scene": scene, "codec": codec,
            "rate": f"r{number}", "bpp": bits, "scale": SCALE,
            "truth_acd_ba_plane": _units(fraction * mm * (1.2 if seed == 2 else 0.8)),
        }
        for codec, fractions in of_scan.items()
        for scene, mm in scan_mm.items()
        for seed in (1, 2)
        for number, (bits, fraction) in enumerate(zip(BITS, fractions, strict=True))
    )  # fmt: skip


def _scans(scan_mm: dict[str, float]) -> pd.DataFrame:
    return pd.DataFrame(
        {"dataset": "rooms", "cloud": f"{scene}-{seed}", "truth_acd_ba_plane": _units(mm)}
        for scene, mm in scan_mm.items()
        for seed in (1, 2)
    )


SCANS = _scans(SCAN_MM)
CURVES = {"gpcc": (2.0, 1.0, 1.5), "surface": (1.0, 0.25, 0.5)}
SIX = {"a": 10.0, "b": 20.0, "c": 40.0, "d": 20.0, "e": 5.0, "f": 80.0}


def test_values_are_geometric_means_over_scenes_of_the_mean_over_seeds() -> None:
    table = nearest_truth(_rows(CURVES), SCANS).set_index(["codec", "rate"])
    surface = table.loc[("surface", "r1")]
    assert surface["distance"] == "accuracy, plane"
    assert surface["scan_mm"] == pytest.approx((10 * 20 * 40 * 20) ** 0.25)
    assert surface["mm"] == pytest.approx((10 * 20 * 40 * 20) ** 0.25 / 4)
    assert (surface["bpp"], surface["scenes"]) == (pytest.approx(4), 4)
    assert table["percent_of_scan"].tolist() == pytest.approx([200, 100, 150, 100, 25, 50])
    ends = surface[["percent_of_scan_least", "percent_of_scan_most"]].tolist()
    assert ends == pytest.approx([25, 25])
    assert surface[["percent_of_scan_low", "percent_of_scan_high"]].isna().all()


def test_six_scenes_have_an_interval_of_the_logarithm() -> None:
    factors = np.array([1.0, 1.2, 0.8, 1.1, 0.9, 1.0])
    rows = _rows(CURVES, SIX)
    scale = rows["scene"].map(dict(zip(SIX, factors**2, strict=True)))
    rows["truth_acd_ba_plane"] *= scale
    surface = nearest_truth(rows, _scans(SIX)).set_index(["codec", "rate"]).loc[("surface", "r1")]
    logs = np.log(25 * factors)
    expected = stats.t.interval(0.95, 5, logs.mean(), stats.sem(logs))
    ends = surface[["percent_of_scan_low", "percent_of_scan_high"]].tolist()
    assert np.log(ends) == pytest.approx(expected)


def test_lengths_are_no_squares() -> None:
    """The 99 % quantile of 2 units, at 100 units per metre, is 20 mm."""
    rows = _rows({"surface": (1.0, 0.5, 0.25)}).assign(truth_q99_point=2.0)
    scans = SCANS.assign(truth_q99_point=4.0)
    table = nearest_truth(rows, scans).set_index("distance").loc["99 %"]
    assert table["mm"].tolist() == pytest.approx([20] * 3)
    assert table["percent_of_scan"].tolist() == pytest.approx([50] * 3)


def test_bits_are_those_of_the_anchor_over_those_of_the_codec() -> None:
    """Twice the scan's error costs the anchor 1 bit, the scan's own 4, 1.5 times 16."""
    table = truth_bits(_rows(CURVES), SCANS, "gpcc").set_index("rate")
    assert set(table["codec"]) == {"surface"}
    # The codec's first rate, of 1 bit, is as near as the scan: bounds of the ratio.
    assert table["bits_ratio"].tolist() == pytest.approx([1, 4, 16])
    assert table["anchor_bpp"].tolist() == pytest.approx([1, 4, 16])
    assert table.loc["r1", "mm"] == pytest.approx((10 * 20 * 40 * 20) ** 0.25)
    assert table[["scenes", "of"]].to_numpy().tolist() == [[4, 4]] * 3
    assert table["bits_ratio_low"].isna().all()


def test_between_rates_bits_are_interpolated() -> None:
    """From 2 times the error at 1 bit to 0.5 times at 4: the scan's own error at 2 bits."""
    table = truth_bits(
        _rows({"gpcc": (2, 1.0, 1.5), "own": (2, 0.5, 0.5)}, SIX), _scans(SIX), "gpcc"
    )
    row = table.set_index("rate").loc["r1"]
    assert row[["bits_ratio", "bits_ratio_low", "bits_ratio_high"]].tolist() == pytest.approx(
        [2] * 3
    )


def test_a_codec_that_never_comes_as_near_has_no_ratio() -> None:
    table = truth_bits(_rows({**CURVES, "far": (3, 2, 1.1)}), SCANS, "gpcc")
    far = table[table["codec"] == "far"].set_index("rate").loc["r1"]
    assert np.isnan(far["bits_ratio"])
    assert (far["scenes"], far["of"]) == (0, 4)


def test_bits_are_interpolated_between_logarithms() -> None:
    bits, distances = np.array([1.0, 100.0]), np.array([8.0, 2.0])
    assert bits_to_reach(bits, distances, 4.0) == pytest.approx(10)
    assert bits_to_reach(bits, distances, 8.0) == 1
    assert np.isnan(bits_to_reach(bits, distances, 1.0))


def test_beside_a_rate_without_error_nothing_is_interpolated() -> None:
    assert bits_to_reach(np.array([1.0, 100.0]), np.array([8.0, 0.0]), 4.0) == 100


def test_scans_without_errors_are_refused() -> None:
    exact = SCANS.assign(truth_acd_ba_plane=0.0)
    with pytest.raises(InputError, match="no scan with errors"):
        nearest_truth(_rows(CURVES), exact)
    with pytest.raises(InputError, match="no scan with a true surface"):
        truth_bits(_rows(CURVES), SCANS.drop(columns="truth_acd_ba_plane"), "gpcc")
