"""The table of the distances to the true surface, on curves made by hand."""

import numpy as np
import pandas as pd
import pytest

from puckbench.core.errors import InputError
from puckbench.metrics.tables.nearest_truth import bits_to_reach, nearest_truth

SCALE = 100.0  # units per metre: 1 unit² is 10 mm squared
SCAN_MM = {"a": 10.0, "b": 20.0, "c": 40.0, "d": 20.0}
BITS = (1.0, 4.0, 16.0)


def _units(millimetres: float) -> float:
    return (millimetres / 1000 * SCALE) ** 2


def _rows(of_scan: dict[str, tuple[float, ...]]) -> pd.DataFrame:
    """Curves whose distances are fractions of the scan's own, for two seeds of four scenes."""
    return pd.DataFrame(
        {
            "dataset": "rooms", "cloud": f"{scene}-{seed}", "scene": scene, "codec": codec,
            "rate": f"r{number}", "bpp": bits, "scale": SCALE,
            "truth_acd_ba_plane": _units(fraction * mm + (1 if seed == 2 else -1)),
        }
        for codec, fractions in of_scan.items()
        for scene, mm in SCAN_MM.items()
        for seed in (1, 2)
        for number, (bits, fraction) in enumerate(zip(BITS, fractions, strict=True))
    )  # fmt: skip


SCANS = pd.DataFrame(
    {"dataset": "rooms", "cloud": f"{scene}-{seed}", "truth_acd_ba_plane": _units(mm)}
    for scene, mm in SCAN_MM.items()
    for seed in (1, 2)
)
CURVES = {"gpcc": (2.0, 1.0, 1.5), "surface": (1.0, 0.25, 0.5)}


def test_values_are_medians_over_scenes_of_the_mean_over_seeds() -> None:
    table = nearest_truth(_rows(CURVES), SCANS, "gpcc").set_index("codec")
    surface = table.loc["surface"]
    assert surface["distance"] == "accuracy, plane"
    assert surface["scan_mm"] == pytest.approx(20)
    assert surface["least_mm"] == pytest.approx(5)
    assert surface["percent_of_scan"] == pytest.approx(25)
    assert surface["percent_of_scan_low"] == pytest.approx(25)
    assert (surface["rates"], surface["bpp"], surface["scenes"]) == (2, 4.0, 4)
    # The codec's first rate is as near as the anchor at its best: four times fewer bits at least.
    assert (surface["bits_ratio"], surface["reached"]) == (pytest.approx(4), 4)
    assert table.loc["gpcc", "percent_of_scan"] == pytest.approx(100)
    assert table.loc["gpcc", "bits_ratio"] == pytest.approx(1)


def test_a_codec_that_never_comes_as_near_has_no_ratio() -> None:
    table = nearest_truth(_rows({**CURVES, "far": (3, 2, 1.1)}), SCANS, "gpcc").set_index("codec")
    assert np.isnan(table.loc["far", "bits_ratio"])
    assert (table.loc["far", "reached"], table.loc["far", "rates"]) == (0, 0)


def test_bits_are_interpolated_between_logarithms() -> None:
    bits, distances = np.array([1.0, 100.0]), np.array([8.0, 2.0])
    assert bits_to_reach(bits, distances, 4.0) == pytest.approx(10)
    assert np.isnan(bits_to_reach(bits, distances, 1.0))


def test_scans_without_errors_are_refused() -> None:
    exact = SCANS.assign(truth_acd_ba_plane=0.0)
    with pytest.raises(InputError, match="no scan with errors"):
        nearest_truth(_rows(CURVES), exact, "gpcc")
