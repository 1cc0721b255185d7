"""The table of which codec for what, on curves whose bits are known at every error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from puckbench.tables.uses import uses

SCENES = ("a", "b", "c", "d", "e", "f")
SPREAD = np.exp(0.01 * np.array([-1, 1, -2, 2, -1, 1]))
"""Factors of the bits in the scenes."""


def _rows(codec: str, errors_mm: tuple[float, ...], factor: Any = 1.0, **more: Any) -> pd.DataFrame:
    """A codec whose bits are `factor` / error in each scene (without error: 4 `factor`)."""
    factors = np.broadcast_to(factor, len(SCENES))
    return pd.DataFrame(
        {
            "dataset": "spins", "cloud": scene, "codec": codec, "rate": f"r{n}",
            "bpp": each * (10 / mm if mm else 4.0), "d1_rms_m": mm / 1000, "lossless": mm == 0,
            "hausdorff_point_m": 3 * mm / 1000, "points_in": 1000, "encode_s": 0.01,
            "decode_s": 0.02, "threads": 1, "timed_alone": True, "repeats": 3,
            "encode_real_time": 2.0, "decode_real_time": 1.0,
        } | more
        for scene, each in zip(SCENES, factors, strict=True)
        for n, mm in enumerate(errors_mm)
    )  # fmt: skip


def _used(use: str, *tables: pd.DataFrame, **options: Any) -> pd.DataFrame:
    table = uses(pd.concat(tables), **options)
    return table[table["use"] == use].set_index("codec")


def test_the_fewest_bits_at_an_error_win() -> None:
    """Bits at 5 mm lie between the rates of 10 and 2.5 mm: 10 / 5 times the factor."""
    table = _used("within_5_mm", _rows("y", (10, 2.5), 1.5 * SPREAD), _rows("x", (10, 2.5)))
    assert list(table.index) == ["x", "y"]
    x, y = table.loc["x"], table.loc["y"]
    assert x[["bpp", "error_mm", "largest_mm", "seconds"]].tolist() == pytest.approx([2, 5, 15, 30])
    assert (x["ratio"], x["verdict"], x["scenes"]) == (1, "fewest bits", 6)
    half = 2.5706 * np.std(np.log(SPREAD), ddof=1) / 6**0.5
    assert y[["ratio", "ratio_low", "ratio_high"]].tolist() == pytest.approx(
        [1.5, 1.5 * np.exp(-half), 1.5 * np.exp(half)], rel=1e-5
    )
    assert y["verdict"] == "worse"


def test_no_winner_while_one_interval_includes_equality() -> None:
    near = np.array([1.1, 0.95, 1.1, 0.95, 1.1, 0.95])
    table = _used(
        "within_5_mm", _rows("x", (10, 2)), _rows("y", (10, 2), 2), _rows("z", (10, 2), near)
    )
    assert table["verdict"].to_dict() == {"x": "undecided", "z": "undecided", "y": "worse"}


@pytest.mark.parametrize(("margin", "verdict"), [(5.0, "not worse"), (1.0, "undecided")])
def test_a_rival_within_the_margin_is_not_worse(margin: float, verdict: str) -> None:
    """At most 3 % more bits."""
    near = np.array([1.03, 0.99, 1.02, 0.99, 1.02, 0.99])
    table = _used(
        "within_5_mm", _rows("x", (10, 2)), _rows("y", (10, 2), near), margin_percent=margin
    )
    assert table["verdict"].to_dict() == {"x": "undecided", "y": verdict}


def test_five_scenes_have_no_winner() -> None:
    both = pd.concat([_rows("x", (10, 2)), _rows("y", (10, 2), 3)])
    table = _used("within_5_mm", both[both["cloud"] != "f"])
    assert table["ratio"].tolist() == pytest.approx([1, 3])
    assert set(table["verdict"]) == {"no verdict"}
    assert table[["ratio_low", "ratio_high"]].isna().all(axis=None)


def test_seeds_are_no_scenes() -> None:
    """Twelve clouds of three scenes; a scene's bits are the mean over its seeds."""
    both = pd.concat([_rows("x", (10, 2), [1, 3, 1, 3, 1, 3]), _rows("y", (10, 2), 6)])
    both["scene"] = both["cloud"].map(dict(zip(SCENES, "ppqqrr", strict=True)))
    table = _used("within_5_mm", both)
    assert table["scenes"].tolist() == [3, 3]
    assert table.loc["y", "ratio"] == pytest.approx(6 / 2)
    assert set(table["verdict"]) == {"no verdict"}


def test_who_serves_some_scenes_alone_is_last_without_a_verdict() -> None:
    """The codec of the fewest bits has errors of 6 mm at least in one scene."""
    part = _rows("part", (10, 2), 0.1)
    part = part[(part["cloud"] != "c") | (part["rate"] == "r0")]
    table = _used("within_5_mm", part, _rows("x", (10, 2)), _rows("y", (10, 2), 2))
    assert list(table.index) == ["x", "y", "part"]
    assert (table.loc["part", "verdict"], table.loc["part", "scenes"]) == ("no verdict", 5)
    assert np.isnan(table.loc["part", "ratio"])
    assert table.loc["x", "verdict"] == "undecided"  # there it needs more bits
    dear = part.assign(bpp=50 * part["bpp"])
    table = _used("within_5_mm", dear, _rows("x", (10, 2)), _rows("y", (10, 2), 2))
    assert table.loc["x", "verdict"] == "undecided"  # five scenes are too few to tell


def test_who_never_serves_a_use_is_left_out() -> None:
    table = uses(pd.concat([_rows("x", (10, 2)), _rows("coarse", (10, 6)), _rows("y", (10, 2), 2)]))
    assert set(table["codec"]) == {"x", "y"}
    assert set(table["use"]) == {"within_5_mm", "real_time"}


def test_an_archive_takes_lossless_rates_alone() -> None:
    table = _used("archive", _rows("x", (10, 0), 1.5), _rows("y", (10, 0)), _rows("z", (10, 0.1)))
    assert table["bpp"].to_dict() == pytest.approx({"y": 4, "x": 6})
    assert table["error_mm"].tolist() == [0, 0]
    assert table["verdict"].tolist() == ["fewest bits", "worse"]


def test_a_map_is_about_the_distances_to_the_true_surface() -> None:
    """99 % of the distances are ten times the RMS error: 50 mm is reached at 5 mm."""
    x, y = _rows("x", (10, 2.5)), _rows("y", (10, 2.5), 2)
    both = pd.concat([x, y])
    table = _used("map", both.assign(truth_q99_point_m=10 * both["d1_rms_m"]))
    assert table[["bpp", "error_mm"]].to_numpy().ravel() == pytest.approx([2, 50, 4, 50])


# ---- nearest to the truth

SCAN = {"dataset": "spins", "truth_d2_rms_m": 0.01}


def _near(codec: str, errors_mm: list[list[float]]) -> pd.DataFrame:
    """Distances to the true surface at two rates in each scene."""
    table = _rows(codec, (10, 2.5))
    return table.assign(truth_d2_rms_m=np.ravel(errors_mm) / 1000)


def test_the_nearest_takes_the_rate_that_is_best_in_the_other_scenes() -> None:
    """In one scene the other rate is better, which its own choice must not know."""
    x = _near("x", [[2.9, 6.0]] + 5 * [[4.0, 3.0]])
    y = _near("y", 6 * [[8.0, 9.0]])
    table = _used("nearest", x, y, scan_errors=pd.DataFrame([SCAN]))
    assert table["error_mm"].to_dict() == pytest.approx({"x": (6 * 3**5) ** (1 / 6), "y": 8})
    assert table["bpp"].to_dict() == pytest.approx({"x": 4, "y": 1})
    assert table["verdict"].tolist() == ["nearest", "worse"]
    assert table.loc["y", "ratio"] == pytest.approx(8 / (6 * 3**5) ** (1 / 6))


def test_the_nearest_is_named_if_its_interval_excludes_equality() -> None:
    x = _near("x", 6 * [[2.0, 3.0]])
    y = _near("y", 3 * [[1.9, 3.0], [2.3, 3.0]])
    table = _used("nearest", x, y, scan_errors=pd.DataFrame([SCAN]))
    assert table["verdict"].tolist() == ["undecided", "undecided"]


@pytest.mark.parametrize("scan", [None, pd.DataFrame([{**SCAN, "truth_d2_rms_m": 0.001}])])
def test_scans_without_noise_are_not_ranked_by_nearness(scan: pd.DataFrame | None) -> None:
    tables = _near("x", 6 * [[2.0, 3.0]]), _near("y", 6 * [[4.0, 3.0]])
    assert _used("nearest", *tables, scan_errors=scan).empty


def test_who_fails_on_one_seed_of_a_scene_does_not_serve_it() -> None:
    """Twelve clouds of six scenes: the codec of the fewest bits has 60 mm on every second seed."""
    clouds = {"x": _rows("x", (10, 2), 0.1), "y": _rows("y", (10, 2))}
    seeds = [
        rows.assign(
            cloud=rows["cloud"] + seed, scene=rows["cloud"], **({} if codec == "y" else more)
        )
        for codec, rows in clouds.items()
        for seed, more in (("1", {}), ("2", {"d1_rms_m": 0.06}))
    ]
    table = _used("within_5_mm", *seeds)
    assert list(table.index) == ["y"]


# ---- as fast as the sensor


def test_real_time_takes_rates_that_are_fast_enough() -> None:
    """The rate of fewer bits is too slow to decode; of several threads one's time is unknown."""
    slow = _rows("slow", (5, 2.5), 0.1)
    slow["decode_real_time"] = slow["rate"].map({"r0": 0.9, "r1": 1.0})
    many = _rows("many", (10, 2.5), 0.01, threads=4)
    table = _used("real_time", slow, _rows("x", (10, 2.5)))
    assert table["bpp"].to_dict() == pytest.approx({"slow": 0.4, "x": 2})
    assert table.loc["slow", "verdict"] == "fewest bits"
    table = _used("real_time", slow, many, _rows("x", (10, 2.5)))
    assert set(table.index) == {"slow", "x"}
    assert set(table["verdict"]) == {"no verdict"}


@pytest.mark.parametrize("change", [{"repeats": 2}, {"timed_alone": False}])
def test_real_time_needs_times_that_can_be_ranked(change: dict[str, Any]) -> None:
    tables = _rows("x", (10, 2.5)), _rows("y", (10, 2.5), 3, **change)
    table = _used("real_time", *tables)
    assert table["ratio"].tolist() == pytest.approx([1, 3])
    assert set(table["verdict"]) == {"no verdict"}
    assert _used("within_5_mm", *tables).loc["x", "verdict"] == "fewest bits"


def test_without_times_there_is_no_real_time() -> None:
    rows = pd.concat([_rows("x", (10, 2.5)), _rows("y", (10, 2.5), 3)])
    rows = rows.drop(columns=["encode_s", "decode_s", "encode_real_time", "decode_real_time"])
    assert _used("real_time", rows).empty
    assert _used("within_5_mm", rows)["seconds"].isna().all()
