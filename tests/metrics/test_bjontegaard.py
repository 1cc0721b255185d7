"""Bjontegaard deltas against closed forms and the numbers of the PyPI package bjontegaard 1.3.0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from puckbench.cli import main
from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.metrics.bjontegaard import NO_COMMON_RANGE, TOO_FEW_POINTS, curve, delta
from puckbench.metrics.rate_deltas import bd_rate, bd_rate_clouds, bootstrap_interval

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
    found = delta(*(curve(np.array(rate), np.array(psnr)) for rate, psnr in (anchor, tested)))
    assert (found.rate_percent, found.quality_db) == pytest.approx(expected, rel=1e-9)


def test_half_the_rate_everywhere_is_minus_fifty_percent() -> None:
    found = delta(curve(RATES, PSNRS), curve(RATES / 2, PSNRS))
    assert found.rate_percent == pytest.approx(-50)
    assert found.shared == 1


def test_a_better_quality_everywhere_is_the_quality_delta() -> None:
    assert delta(curve(RATES, PSNRS), curve(RATES, PSNRS + 3)).quality_db == pytest.approx(3)


def test_curves_without_a_common_range_have_no_delta_and_say_so() -> None:
    found = delta(curve(RATES, PSNRS), curve(RATES, PSNRS + 100))
    assert (found.rate_percent, found.rate_status) == (None, NO_COMMON_RANGE)
    assert found.quality_db == pytest.approx(100)
    assert delta(curve(RATES, PSNRS), curve(RATES[:1], PSNRS[:1])).rate_status == TOO_FEW_POINTS


def test_points_that_a_cheaper_one_equals_are_left_out() -> None:
    worse = curve(np.array([0.1, 0.2, 0.3, 0.3, 0.4]), np.array([40.0, 39.0, 45.0, 44.0, 45.0]))
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


def test_the_bootstrap_interval_is_that_of_the_mean() -> None:
    values = generator(1, "values").normal(2, 1, 400)
    low, high = bootstrap_interval(values, 4000, generator(1, "draws"))
    error = values.std(ddof=1) / 20
    assert (low, high) == pytest.approx(
        (values.mean() - 1.96 * error, values.mean() + 1.96 * error), abs=0.15 * error
    )
    assert np.isnan(bootstrap_interval(values[:2], 100, generator(1, "draws"))).all()


def test_an_interval_repeats_and_does_not_hang_on_the_other_codecs() -> None:
    table = metrics({"a": [1] * 4, "b": [0.5, 0.6, 0.7, 0.8], "c": [2, 3, 4, 5]})
    whole = bd_rate(table, "a", ["d1_psnr"])
    alone = bd_rate(table[table["codec"] != "c"], "a", ["d1_psnr"])
    pd.testing.assert_frame_equal(whole[whole["codec"] == "b"], alone)


@pytest.mark.parametrize(
    ("anchor", "metric", "fault"),
    [
        ("z", "d1_psnr", "no results of the anchor 'z' .there are a, b"),
        ("a", "psnr", "no column 'psnr'"),
    ],
)
def test_an_unknown_anchor_or_column_is_named(anchor: str, metric: str, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        bd_rate(metrics({"a": [1], "b": [2]}), anchor, [metric])


def test_the_command_makes_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    metrics({"a": [1] * 3, "b": [0.5] * 3}).to_csv(tmp_path / "m.csv", index=False)
    words = ["table", "bd_rate", str(tmp_path / "out.csv")]
    words += ["--inputs", f'{{"metrics": "{tmp_path}/m.csv"}}', "--options"]
    assert main([*words, '{"anchor": "a", "qualities": ["d1_psnr"]}']) == 0
    assert pd.read_csv(tmp_path / "out.csv")["bd_rate_percent"].tolist() == [-50.0]
    assert main([*words, '{"anker": "a"}']) == 2
    assert "table bd_rate: options: missing a required argument" in capsys.readouterr().err
