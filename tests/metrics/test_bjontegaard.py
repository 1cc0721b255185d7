"""Bjontegaard deltas against closed forms and the numbers of the PyPI package bjontegaard 1.3.0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from puckbench.cli import main
from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.metrics.bjontegaard import (
    COMPARED,
    LITTLE_OVERLAP,
    NO_COMMON_RANGE,
    TOO_FEW_POINTS,
    bjontegaard_delta,
    rate_distortion_curve,
)
from puckbench.metrics.tables.rate_deltas import (
    bd_rate,
    bd_rate_clouds,
    bootstrap_interval,
    is_below_zero,
    log_ratios,
)

RATES = np.array([0.1, 0.3, 0.8, 2.0, 5.0])
PSNRS = np.array([40.0, 48.0, 55.0, 62.0, 71.0])

# The example in that package's description, and a pair of curves with other counts and ranges;
# its answers with method "pchip" (bd_rate in percent, bd_psnr in dB).
PUBLISHED = [
    (
        ([9487.76, 4593.60, 2486.44, 1358.24], [40.037, 38.615, 36.845, 34.851]),
        ([9787.80, 4469.00, 2451.52, 1356.24], [40.121, 38.651, 36.970, 34.987]),
        (-4.417485350589045, 0.11969278542479489),
    ),
    (
        ([0.06, 0.2, 0.5, 1.1, 2.4, 4.8], [40.1, 47.2, 53.0, 58.8, 64.9, 70.2]),
        ([0.09, 0.28, 0.55, 1.3, 3.0, 3.9], [45.0, 50.5, 55.1, 60.0, 64.0, 69.0]),
        (-5.346359513861298, 0.493729926440437),
    ),
]


@pytest.mark.parametrize(("anchor", "tested", "expected"), PUBLISHED)
def test_deltas_are_those_of_an_independent_implementation(
    anchor: tuple[list[float], ...],
    tested: tuple[list[float], ...],
    expected: tuple[float, float],
) -> None:
    delta = bjontegaard_delta(
        *(rate_distortion_curve(np.array(rate), np.array(psnr)) for rate, psnr in (anchor, tested))
    )
    assert (delta.rate_percent, delta.quality_db) == pytest.approx(expected, rel=1e-9)


def test_half_the_rate_everywhere_is_minus_fifty_percent() -> None:
    delta = bjontegaard_delta(
        rate_distortion_curve(RATES, PSNRS), rate_distortion_curve(RATES / 2, PSNRS)
    )
    assert delta.rate_percent == pytest.approx(-50)
    assert delta.overlap == 1


def test_a_better_quality_everywhere_is_the_quality_delta() -> None:
    assert bjontegaard_delta(
        rate_distortion_curve(RATES, PSNRS), rate_distortion_curve(RATES, PSNRS + 3)
    ).quality_db == pytest.approx(3)


def test_curves_without_a_common_range_have_no_delta_and_say_so() -> None:
    delta = bjontegaard_delta(
        rate_distortion_curve(RATES, PSNRS), rate_distortion_curve(RATES, PSNRS + 100)
    )
    assert (delta.rate_percent, delta.rate_status, delta.overlap) == (None, NO_COMMON_RANGE, 0)
    assert delta.quality_db == pytest.approx(100)
    touching = bjontegaard_delta(
        rate_distortion_curve(RATES, PSNRS), rate_distortion_curve(RATES, PSNRS + 31)
    )
    assert (touching.rate_percent, touching.rate_status) == (None, NO_COMMON_RANGE)
    single = bjontegaard_delta(
        rate_distortion_curve(RATES, PSNRS), rate_distortion_curve(RATES[:1], PSNRS[:1])
    )
    assert (single.rate_status, single.overlap) == (TOO_FEW_POINTS, 0)


def test_two_points_make_a_curve() -> None:
    """Straight in the logarithm of the rate: from 30 dB at a rate of 1 to 40 dB at 4."""
    anchor, tested = (
        rate_distortion_curve(np.array([1.0, 4]), np.array([30.0, 40])),
        np.array([35.0, 45]),
    )
    delta = bjontegaard_delta(anchor, rate_distortion_curve(np.array([1.0, 4]), tested))
    assert delta.rate_percent == pytest.approx(-50)
    assert delta.quality_db == pytest.approx(5)
    assert delta.overlap == pytest.approx(0.5)


def test_points_without_a_rate_or_a_quality_are_left_out() -> None:
    rates, psnrs = np.array([0.1, np.nan, 0.8, 2.0]), np.array([40.0, 48.0, np.inf, 62.0])
    curve = rate_distortion_curve(rates, psnrs)
    np.testing.assert_allclose(np.exp(curve.log_rate), [0.1, 2.0])
    assert curve.dropped == 0


def test_points_that_a_cheaper_one_equals_are_left_out() -> None:
    worse = rate_distortion_curve(
        np.array([0.1, 0.2, 0.3, 0.3, 0.4]), np.array([40.0, 39.0, 45.0, 44.0, 45.0])
    )
    np.testing.assert_allclose(np.exp(worse.log_rate), [0.1, 0.3])
    assert worse.dropped == 3


def metrics(ratios: dict[str, list[float]], shift: float = 0.0) -> pd.DataFrame:
    """Codecs with so many times the anchor's rates on each cloud, and a quality shift in dB."""
    rows = [
        {
            "dataset": "d",
            "cloud": f"c{cloud}",
            "codec": codec,
            "rate": f"r{i}",
            "bpp": bpp * ratio,
            "d1_psnr": psnr + (shift if codec != "a" else 0),
            "d1_mse": 10 ** (-psnr / 10),
        }
        for codec, values in ratios.items()
        for cloud, ratio in enumerate(values)
        for i, (bpp, psnr) in enumerate(zip(RATES, PSNRS, strict=True))
    ]
    return pd.DataFrame(rows)


def test_clouds_are_averaged_in_the_logarithm_of_the_rate() -> None:
    table = metrics({"a": [1, 1, 1], "b": [0.5, 2, 1]})
    row = bd_rate(table, "a", ["d1_psnr"]).iloc[0]
    assert row["bd_rate_percent"] == pytest.approx(0, abs=1e-9)
    assert row["bd_rate_percent_arithmetic"] == pytest.approx((-50 + 100 + 0) / 3)
    assert row["bd_rate_percent_median"] == pytest.approx(0, abs=1e-9)
    assert row["bd_rate_percent_low"] < 0 < row["bd_rate_percent_high"]
    assert (row["clouds"], row["compared"]) == (3, 3)
    other = bd_rate(table, "b", ["d1_psnr"]).iloc[0]
    assert other["bd_rate_percent"] == pytest.approx(0, abs=1e-9)


def test_seeds_of_a_scene_count_once() -> None:
    """Ten seeds of one scene weigh as much as the one cloud of another, also in the interval."""
    ratios = [0.5] * 10 + [2, 1, 1]
    seeds = metrics({"a": [1] * 13, "b": ratios})
    numbers = seeds["cloud"].str.removeprefix("c").astype(int)
    seeds["scene"] = "s" + numbers.where(numbers >= 10, 0).astype(str)
    scenes = metrics({"a": [1] * 4, "b": [0.5, 2, 1, 1]})
    deltas, expected = (bd_rate(table, "a", ["d1_psnr"]).iloc[0] for table in (seeds, scenes))
    for column in ("bd_rate_percent", "bd_rate_percent_low", "bd_rate_percent_high"):
        assert deltas[column] == pytest.approx(expected[column])


def test_a_distortion_is_compared_in_decibels() -> None:
    table = metrics({"a": [1], "b": [0.5]})
    both = bd_rate_clouds(table, "a", ["d1_psnr", "d1_mse"])
    assert both["bd_rate_percent"].tolist() == pytest.approx([-50, -50])
    table.loc[table["codec"] == "b", "d1_mse"] /= 2
    alike = table.assign(bpp=table.groupby("codec")["bpp"].transform(lambda _: RATES))
    row = bd_rate_clouds(alike, "a", ["d1_mse"]).iloc[0]
    assert row["bd_quality_db"] == pytest.approx(10 * np.log10(2))


def test_clouds_without_a_common_range_are_counted_and_count_in_no_mean() -> None:
    row = bd_rate(metrics({"a": [1] * 4, "b": [0.5] * 4}, shift=100), "a", ["d1_psnr"]).iloc[0]
    assert (row["compared"], row["no_common_range"]) == (0, 4)
    assert np.isnan(row["bd_rate_percent"])
    assert row["bd_quality_db"] > 90


def test_lossless_points_have_no_quality_and_are_left_out() -> None:
    table = metrics({"a": [1], "b": [0.5]})
    table.loc[table["rate"] == "r4", "d1_psnr"] = np.nan
    row = bd_rate_clouds(table, "a", ["d1_psnr"]).iloc[0]
    assert (row["points"], row["anchor_points"]) == (4, 4)
    assert row["bd_rate_percent"] == pytest.approx(-50)


def test_codecs_stand_in_the_order_of_the_results() -> None:
    table = metrics({"z": [1, 1], "y": [0.5, 0.5], "x": [2, 2]})
    table["cloud"] = table["cloud"].map({"c0": "d", "c1": "c"})
    clouds = bd_rate_clouds(table, "z", ["d1_psnr"])
    assert list(zip(clouds["cloud"], clouds["codec"], strict=True)) == [
        ("d", "y"), ("d", "x"), ("c", "y"), ("c", "x"),
    ]  # fmt: skip
    assert bd_rate(table, "z", ["d1_psnr"])["codec"].tolist() == ["y", "x"]


def test_a_cloud_that_the_anchor_lacks_has_no_row() -> None:
    table = metrics({"a": [1, 1], "b": [0.5, 0.5]})
    fewer = table[(table["codec"] != "a") | (table["cloud"] != "c0")]
    assert bd_rate_clouds(fewer, "a", ["d1_mse"])["cloud"].tolist() == ["c1"]


def test_a_codec_without_error_has_no_curve_and_says_so() -> None:
    table = metrics({"a": [1, 1], "b": [0.5, 0.5]})
    table.loc[table["codec"] == "b", "d1_mse"] = 0.0
    row = bd_rate(table, "a", ["d1_mse"]).iloc[0]
    assert (row["compared"], row["too_few_points"]) == (0, 2)
    assert (row["lossless"], row["anchor_lossless"]) == (10, 0)
    exact = table.assign(d1_mse=0.0).drop(columns="d1_psnr")
    assert bd_rate(exact, "a", ["d1_psnr"]).iloc[0]["too_few_points"] == 2


def exponential(
    slope: float = 6.0, scale: float = 1.0, steps: int = 6, low: float = 50.0, high: float = 80.0
) -> tuple[np.ndarray, np.ndarray]:
    """Rates and qualities of the rate_distortion_curve rate = scale * 2^(quality / slope)."""
    quality = np.linspace(low, high, steps)
    return scale * 2 ** (quality / slope) / 1000, quality


@pytest.mark.parametrize("scale", [0.6, 1.0, 1.7])
def test_exponential_curves_have_the_delta_of_their_closed_form(scale: float) -> None:
    delta = bjontegaard_delta(
        rate_distortion_curve(*exponential()),
        rate_distortion_curve(*exponential(scale=scale, steps=4)),
    )
    assert delta.rate_percent == pytest.approx(100 * (scale - 1), abs=1e-9)
    # slopes s and t: the mean of ln 2 * q * (1/t - 1/s) over q from 50 to 80 dB, at q = 65
    steeper = bjontegaard_delta(
        rate_distortion_curve(*exponential(slope=6)), rate_distortion_curve(*exponential(slope=5))
    )
    assert steeper.log_ratio == pytest.approx(np.log(2) * 65 * (1 / 5 - 1 / 6))


@pytest.mark.parametrize(("share", "status"), [(0.49, LITTLE_OVERLAP), (0.51, COMPARED)])
def test_curves_that_share_less_than_half_of_the_shorter_one_have_no_delta(
    share: float, status: str
) -> None:
    """The shorter curve is 20 dB long, of which `share` lies below the anchor's 80 dB."""
    low = 80 - 20 * share
    delta = bjontegaard_delta(
        rate_distortion_curve(*exponential()),
        rate_distortion_curve(*exponential(scale=2, low=low, high=low + 20)),
    )
    assert (delta.rate_status, delta.overlap) == (status, pytest.approx(share))
    assert (delta.rate_percent is None) == (status == LITTLE_OVERLAP)
    # the rates of both span as many octaves as dB over 6, and are twice as large
    by_rate = 80 - 20 * share - 6
    alike = rate_distortion_curve(*exponential(scale=2, low=by_rate, high=by_rate + 20))
    assert bjontegaard_delta(rate_distortion_curve(*exponential()), alike).quality_status == status


def rows_of_a_curve(codec: str, rates: np.ndarray, psnrs: np.ndarray) -> list[dict[str, object]]:
    return [
        {
            "dataset": "d",
            "cloud": "c",
            "codec": codec,
            "rate": f"r{i}",
            "bpp": rate,
            "d1_psnr": psnr,
            "d1_mse": 3 * 30**2 * 10 ** (-psnr / 10),
            "hausdorff_point": 2 * (3 * 30**2 * 10 ** (-psnr / 10)) ** 0.5,
            "diameter": 150.0,
        }
        for i, (rate, psnr) in enumerate(zip(rates, psnrs, strict=True))
    ]


def test_a_rate_whose_errors_are_rounding_moves_no_delta() -> None:
    """A rate at 164 dB is an error of 1 um in 150 m: of single precision, not of coding."""
    lossy = [exponential(), exponential(scale=1.25)]
    exact = [(np.append(r, 12.0 * f), np.append(q, 164.0 + f)) for f, (r, q) in enumerate(lossy, 1)]
    tables = [
        pd.DataFrame([*rows_of_a_curve("a", *a), *rows_of_a_curve("b", *b)])
        for a, b in (lossy, exact, [exact[0], lossy[1]])
    ]
    without, both, mixed = [bd_rate(table, "a", ["d1_psnr", "d1_mse"]) for table in tables]
    assert without["bd_rate_percent"].tolist() == pytest.approx([25, 25])
    for table, counts in ((both, [1, 1]), (mixed, [0, 1])):
        assert table["bd_rate_percent"].tolist() == without["bd_rate_percent"].tolist()
        assert table[["lossless", "anchor_lossless"]].to_numpy().tolist() == [counts] * 2
    marked = tables[1].assign(lossless=tables[1]["d1_psnr"] > 100).drop(columns="diameter")
    assert bd_rate(marked, "a", ["d1_psnr"])["bd_rate_percent"].tolist() == pytest.approx([25])


def test_psnrs_of_several_peaks_on_a_cloud_are_not_compared() -> None:
    table = metrics({"a": [1], "b": [2]})
    table["peak"] = np.where(table["codec"] == "a", 30.0, 59.7)
    with pytest.raises(InputError, match=r"PSNRs of d/c0 have the peaks 30 and 59\.7"):
        bd_rate(table, "a", ["d1_psnr"])
    assert bd_rate(table, "a", ["d1_mse"])["bd_rate_percent"].tolist() == pytest.approx([100])


@pytest.mark.parametrize(
    ("differences", "is_below"),
    [
        ([-0.2], True),
        ([0.2], False),
        ([-0.2, 0.01], False),
        ([-0.2, -0.3, -0.1, -0.2], True),
        ([-0.2, 0.3, -0.4, 0.2], False),
        ([], False),
    ],
)
def test_a_difference_is_told_from_chance(differences: list[float], is_below: bool) -> None:
    assert is_below_zero(np.array(differences)) == is_below


def test_the_ratio_of_two_codecs_is_that_of_each_cloud() -> None:
    table = metrics({"a": [1, 1, 1], "b": [0.5, 2, 1], "c": [0.25, 0.5, 4]})
    ratios = log_ratios(table, "b", "c", "d1_psnr")
    assert np.exp(ratios).tolist() == pytest.approx([0.5, 0.25, 4])


def test_the_spread_over_clouds_is_told_by_its_quartiles() -> None:
    """Of the rate ratios 1/2, 1, 2, 3, 9: changes of -50, 0, 100, 200 and 800 %."""
    table = metrics({"a": [1] * 5, "b": [0.5, 1, 2, 3, 9]})
    table.loc[
        (table["codec"] == "b") & (table["cloud"] == "c2") & (table["rate"] != "r1"), "bpp"
    ] = np.nan
    row = bd_rate(table, "a", ["d1_psnr"]).iloc[0]
    assert (row["clouds"], row["compared"], row["too_few_points"]) == (5, 4, 1)
    names = ["bd_rate_percent_q25", "bd_rate_percent_median", "bd_rate_percent_q75"]
    assert row[names].tolist() == pytest.approx([-12.5, 100, 350])
    assert row["bd_rate_percent"] == pytest.approx(100 * (13.5**0.25 - 1))


def test_the_bootstrap_interval_is_that_of_the_mean() -> None:
    """As the central limit theorem has it, for values of a symmetric distribution."""
    values = np.linspace(-1, 1, 41)
    low, high = bootstrap_interval(values, 100_000, generator(1, "draws"))
    error = values.std() / 41**0.5
    assert (low, high) == pytest.approx((-1.96 * error, 1.96 * error), abs=0.04 * error)
    assert np.isnan(bootstrap_interval(values[:2], 100, generator(1, "draws"))).all()
    assert np.isfinite(bootstrap_interval(values[:3], 100, generator(1, "draws"))).all()


def test_an_interval_is_of_two_thousand_draws_unless_asked_otherwise() -> None:
    table = metrics({"a": [1] * 4, "b": [0.5, 0.6, 0.7, 0.8]})
    both = ["d1_psnr", "d1_mse"]
    pd.testing.assert_frame_equal(bd_rate(table, "a", both), bd_rate(table, "a", both, 2000, 0))


def test_an_interval_repeats_and_does_not_hang_on_the_other_codecs() -> None:
    table = metrics({"a": [1] * 4, "b": [0.5, 0.6, 0.7, 0.8], "c": [2, 3, 4, 5]})
    whole = bd_rate(table, "a", ["d1_psnr"])
    alone = bd_rate(table[table["codec"] != "c"], "a", ["d1_psnr"])
    pd.testing.assert_frame_equal(whole[whole["codec"] == "b"], alone)


@pytest.mark.parametrize(
    ("anchor", "metric", "fault"),
    [
        ("z", "d1_psnr", "no results of the anchor 'z' .known: a, b"),
        ("a", "psnr", "no column 'psnr'"),
    ],
)
def test_an_unknown_anchor_or_column_is_named(anchor: str, metric: str, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        bd_rate(metrics({"a": [1], "b": [2]}), anchor, [metric])


def test_a_rate_of_nothing_is_refused() -> None:
    table = metrics({"a": [1], "b": [2]})
    table.loc[3, "bpp"] = 0.0
    with pytest.raises(InputError, match="'bpp' must be positive, but is not for a of d/c0/r3"):
        bd_rate(table, "a", ["d1_psnr"])


def test_the_command_makes_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    metrics({"a": [1] * 3, "b": [0.5] * 3}).to_csv(tmp_path / "m.csv", index=False)
    words = ["table", "bd_rate", str(tmp_path / "out.csv")]
    words += ["--inputs", f'{{"metrics": "{tmp_path}/m.csv"}}', "--options"]
    assert main([*words, '{"anchor": "a", "qualities": ["d1_psnr"]}']) == 0
    assert pd.read_csv(tmp_path / "out.csv")["bd_rate_percent"].tolist() == [-50.0]
    assert main([*words, '{"anker": "a"}']) == 2
    assert "table bd_rate: options: missing a required argument" in capsys.readouterr().err
