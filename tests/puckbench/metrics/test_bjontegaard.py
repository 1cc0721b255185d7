"""Bjontegaard deltas against closed forms and the numbers of the PyPI package bjontegaard 1.3.0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pointkit.errors import InputError
from puckbench.cli import main
from puckbench.metrics.bjontegaard import (
    COMPARED,
    LITTLE_OVERLAP,
    NO_COMMON_RANGE,
    TOO_FEW_POINTS,
    bjontegaard_delta,
    rate_distortion_curve,
)
from puckbench.tables.rate_deltas import bd_rate, bd_rate_clouds, bd_rate_pairs

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


def test_points_without_a_rate_or_a_quality_are_left_out() -> None:
    rates, psnrs = np.array([0.1, np.nan, 0.8, 2.0]), np.array([40.0, 48.0, np.inf, 62.0])
    curve = rate_distortion_curve(rates, psnrs)
    np.testing.assert_allclose(np.exp(curve.log_rate), [0.1, 2.0])
    assert curve.pooled == 0


def test_points_at_which_more_bits_are_no_better_are_pooled() -> None:
    """Rates of 1, 2, 4, 8, 16: the third is worse than the second, the last equals the fourth."""
    curve = rate_distortion_curve(2.0 ** np.arange(5), np.array([40.0, 50, 44, 60, 60]))
    np.testing.assert_allclose(curve.log_rate / np.log(2), [0, 1.5, 3.5], atol=1e-12)
    assert curve.quality.tolist() == [40, 47, 60]
    assert curve.pooled == 2


def test_a_pool_that_is_no_better_than_the_one_before_joins_it() -> None:
    """50 and 40 make 45, which 48 before it exceeds: the three are one point of mean 46."""
    curve = rate_distortion_curve(2.0 ** np.arange(5), np.array([30.0, 48, 50, 40, 70]))
    np.testing.assert_allclose(curve.log_rate / np.log(2), [0, 2, 4], atol=1e-12)
    assert curve.quality.tolist() == [30, 46, 70]


def test_points_of_one_rate_are_pooled() -> None:
    curve = rate_distortion_curve(np.array([2.0, 1, 2]), np.array([50.0, 40, 46]))
    np.testing.assert_allclose(np.exp(curve.log_rate), [1, 2])
    assert curve.quality.tolist() == [40, 48]


def test_a_bad_rate_costs_bits() -> None:
    """A tenth of the quality's range is lost at one rate: the codec is worse than without."""
    good = rate_distortion_curve(RATES, PSNRS)
    bad = rate_distortion_curve(np.append(RATES, 6.0), np.append(PSNRS, 60.0))
    assert bjontegaard_delta(good, bad).rate_percent > 0


@pytest.mark.parametrize("count", [3, 4])
def test_a_curve_needs_four_points(count: int) -> None:
    tested = rate_distortion_curve(RATES[:count] / 2, PSNRS[:count])
    for anchor, other in (
        (rate_distortion_curve(RATES, PSNRS), tested),
        (tested, rate_distortion_curve(RATES, PSNRS)),
    ):
        status = bjontegaard_delta(anchor, other).rate_status
        assert status == (TOO_FEW_POINTS if count < 4 else COMPARED)


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
    assert (row["clouds"], row["compared"], row["scenes"]) == (3, 3, 3)
    other = bd_rate(table, "b", ["d1_psnr"]).iloc[0]
    assert other["bd_rate_percent"] == pytest.approx(0, abs=1e-9)


def test_three_scenes_have_extremes_and_no_verdict() -> None:
    row = bd_rate(metrics({"a": [1, 1, 1], "b": [0.5, 0.25, 0.75]}), "a", ["d1_psnr"]).iloc[0]
    extremes = row[["bd_rate_percent_least", "bd_rate_percent_most"]].tolist()
    assert extremes == pytest.approx([-75, -25])
    assert row[["bd_rate_percent_low", "bd_rate_percent_high"]].isna().all()
    assert row["verdict"] == "no verdict"


SIX = np.array([0.5, 0.6, 0.7, 0.55, 0.65, 0.6])
"""Ratios of rates in six scenes."""


def test_six_scenes_have_the_interval_of_their_log_ratios() -> None:
    row = bd_rate(metrics({"a": [1] * 6, "b": list(SIX)}), "a", ["d1_psnr"]).iloc[0]
    logs = np.log(SIX)
    low, high = stats.t.interval(0.95, 5, logs.mean(), stats.sem(logs))
    ends = row[["bd_rate_percent_low", "bd_rate_percent_high"]].tolist()
    assert ends == pytest.approx([100 * np.expm1(low), 100 * np.expm1(high)])
    assert row["verdict"] == "better"


@pytest.mark.parametrize(
    ("percent", "verdict"), [(-1, "better"), (4.9, "not worse"), (5.1, "worse")]
)
def test_the_margin_is_in_percent_of_the_bits(percent: float, verdict: str) -> None:
    """All scenes but for a rounding alike: the interval is as narrow as a point."""
    ratios = (1 + percent / 100) * np.exp(1e-6 * np.array([-1, 1, -1, 1, -1, 1]))
    table = metrics({"a": [1] * 6, "b": list(ratios)})
    assert bd_rate(table, "a", ["d1_psnr"])["verdict"].tolist() == [verdict]
    wide = bd_rate(table, "a", ["d1_psnr"], margin_percent=6)["verdict"].tolist()
    assert wide == ["better" if percent < 0 else "not worse"]


def test_pairs_are_compared_directly_both_ways() -> None:
    """Two codecs' ratio to each other is that of each scene, without the anchor between."""
    table = metrics({"a": [1] * 6, "b": list(SIX), "c": list(2 * SIX * np.array([1, 1.1] * 3))})
    keys = ["codec", "anchor"]
    pairs = bd_rate_pairs(table, "a", ["d1_psnr"]).set_index(keys)
    assert set(pairs.index) == {(x, y) for x in "abc" for y in "abc" if x != y}
    logs = -np.log(2 * np.array([1, 1.1] * 3))
    ends = stats.t.interval(0.95, 5, logs.mean(), stats.sem(logs))
    names = ["bd_rate_percent", "bd_rate_percent_low", "bd_rate_percent_high"]
    expected = 100 * np.expm1([logs.mean(), *ends])
    assert pairs.loc[("b", "c"), names].tolist() == pytest.approx(expected.tolist())
    assert pairs.loc[("b", "c"), "verdict"] == "better"
    assert pairs.loc[("c", "b"), "verdict"] == "worse"
    against = bd_rate(table, "a", ["d1_psnr"]).set_index(keys)
    for codec in "bc":
        pd.testing.assert_series_equal(pairs.loc[(codec, "a")], against.loc[(codec, "a")])


def test_exchanging_codec_and_anchor_inverts_the_ratio() -> None:
    table = metrics({"a": [1] * 6, "b": list(SIX)}, shift=1.5)
    table = table[(table["codec"] == "a") | (table["rate"] != "r4")]
    there, back = (row for _, row in bd_rate_pairs(table, "a", ["d1_psnr"]).iterrows())
    for name, of_back in (("", ""), ("_low", "_high"), ("_least", "_most")):
        ratios = [1 + there[f"bd_rate_percent{name}"] / 100]
        ratios += [1 + back[f"bd_rate_percent{of_back}"] / 100]
        assert ratios[0] == pytest.approx(1 / ratios[1], rel=1e-12)
    assert there["bd_quality_db"] == -back["bd_quality_db"]


def test_the_row_of_an_exchanged_pair_has_its_counts_exchanged() -> None:
    table = metrics({"a": [1] * 2, "b": [0.5] * 2})
    table.loc[(table["codec"] == "a") & (table["rate"] == "r3"), "d1_psnr"] = 50.0  # below r2
    pairs = bd_rate_pairs(table, "a", ["d1_psnr"]).set_index("codec")
    assert pairs[["pooled", "anchor_pooled"]].loc[["a", "b"]].to_numpy().tolist() == [
        [2, 0], [0, 2],
    ]  # fmt: skip


def test_a_row_does_not_hang_on_the_other_codecs() -> None:
    table = metrics({"a": [1] * 6, "b": list(SIX), "c": [2] * 6})
    whole = bd_rate(table, "a", ["d1_psnr"])
    alone = bd_rate(table[table["codec"] != "c"], "a", ["d1_psnr"])
    pd.testing.assert_frame_equal(whole[whole["codec"] == "b"], alone)


def test_seeds_of_a_scene_count_once() -> None:
    """Ten seeds of one scene weigh as much as the one cloud of another, also in the interval."""
    ratios = [0.5] * 10 + [2, 1, 1, 1.5, 0.7]
    seeds = metrics({"a": [1] * 15, "b": ratios})
    numbers = seeds["cloud"].str.removeprefix("c").astype(int)
    seeds["scene"] = "s" + numbers.where(numbers >= 10, 0).astype(str)
    scenes = metrics({"a": [1] * 6, "b": [0.5, 2, 1, 1, 1.5, 0.7]})
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


def test_metrics_of_a_part_count_the_bits_of_this_part() -> None:
    """Codec `b` needs half of the bits of positions, twice those of colours, and more in all."""
    table = metrics({"a": [1] * 6, "b": [0.5] * 6})
    is_b = table["codec"] == "b"
    colours = np.where(is_b, 4, 1) * table["bpp"]
    whole = table.assign(
        bpp_geometry=table["bpp"],
        bpp_colour=colours,
        bpp=table["bpp"] + colours,
        y_psnr=table["d1_psnr"] - 20,
        colour_max_error=9.0,
        pcqm=10 ** (-table["d1_psnr"] / 10),
    )
    names = ["d1_psnr", "y_psnr", "pcqm"]
    rows = bd_rate(whole, "a", names).set_index("metric")
    assert rows["bd_rate_percent"].tolist() == pytest.approx([-50, 100, 25])
    assert rows["bits_counted"].tolist() == ["bpp_geometry", "bpp_colour", "bpp"]
    untold = whole.assign(**{n: whole[n].where(is_b) for n in ("bpp_geometry", "bpp_colour")})
    rows = bd_rate(untold, "a", names)
    assert rows["bd_rate_percent"].tolist() == pytest.approx([25, 25, 25])
    assert set(rows["bits_counted"]) == {"bpp"}


def test_a_codec_of_positions_has_bits_of_positions_only() -> None:
    table = metrics({"a": [1] * 6, "b": [0.5] * 6})
    is_b = table["codec"] == "b"
    table = table.assign(
        bpp_geometry=table["bpp"].where(is_b),
        bpp=table["bpp"] * np.where(is_b, 10, 1),
        colour_max_error=np.where(is_b, 9.0, np.nan),
    )
    (row,) = bd_rate(table, "a", ["d1_psnr"]).to_dict("records")
    assert row["bd_rate_percent"] == pytest.approx(-50)


def test_exact_colours_are_lossless_rates() -> None:
    table = metrics({"a": [1] * 6, "b": [0.5] * 6}).rename(columns={"d1_psnr": "y_psnr"})
    exact = table[table["rate"] == table["rate"].iloc[-1]]
    exact = exact.assign(rate="exact", y_psnr=np.nan, bpp=99.0)
    whole = pd.concat([table, exact])
    whole["colour_lossless"] = whole["rate"] == "exact"
    (row,) = bd_rate(whole.assign(d1_mse=1.0), "a", ["y_psnr"]).to_dict("records")
    assert row["bd_rate_percent"] == pytest.approx(-50)
    assert row["lossless"] == row["anchor_lossless"] == 6
