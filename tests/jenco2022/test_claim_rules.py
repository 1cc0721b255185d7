"""The rules of the claims at their limits: what is just within, and what is just beyond."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest

from jenco2022.claims.catalogue import CLAIMS
from jenco2022.claims.evidence import Evidence
from jenco2022.claims.verdicts import FAILS, HOLDS, IN_PART, needs_text
from jenco2022.published import RATES, medians_of_thesis
from tests.jenco2022 import test_claims
from tests.jenco2022.test_claims import BPP, CODECS, DATASETS, Curve, falling, result, statistics

run = partial(test_claims.run, clouds=5)


def holds(number: int, evidence: Evidence, statement: str) -> bool | None:
    """Whether the part of a claim with this statement holds; None where it was not tested."""
    actual = {part.statement: part.holds for part in CLAIMS[number - 1].test(evidence)}
    verdict = actual.get(statement)
    return None if verdict is None else bool(verdict)


def needed(number: int, evidence: Evidence) -> str:
    return needs_text(CLAIMS[number - 1].test(evidence))


@pytest.mark.parametrize(
    ("mean", "std", "expected"),
    [
        (-0.0049, 0.0140, HOLDS),
        (0.0055, 0.0140, IN_PART),
        (0.0, 0.01445, HOLDS),
        (0.0, 0.01355, HOLDS),
        (0.0, 0.01455, IN_PART),
    ],
)
def test_1_the_mean_is_zero_to_a_centimetre_and_the_std_is_14_mm(
    mean: float, std: float, expected: str
) -> None:
    rows = [("real", surface, "all", "all", mean, std) for surface in ("all", "wall", "floor")]
    assert result(1, Evidence(residual_statistics=statistics(*rows)))[0] == expected
    floors = Evidence(residual_statistics=statistics(rows[0], rows[2]))
    assert needed(1, floors) == "a capture with a wall"


def noise(std: float, moved: Mapping[str, float], real: float | None = None) -> Evidence:
    rows = [("hdl64e", "all", "all", "all", 0.0, std)]
    rows += [("real", "all", "all", "all", 0.0, real)] if real else []
    quantity = "earth mover's distance to the real residuals, 1 to 5 m"
    numbers = pd.DataFrame({"quantity": quantity, "model": list(moved), "here_m": moved.values()})
    return Evidence(residual_statistics=statistics(*rows), thesis_numbers=numbers)


def test_2_far_too_wide_is_twice_the_real_spread() -> None:
    moved = {"hdl64e": 0.04, "vlp16": 0.0044}
    assert result(2, noise(0.0280, moved))[0] == HOLDS
    assert result(2, noise(0.0270, moved))[0] == IN_PART
    assert result(2, noise(0.0390, moved, real=0.0200))[0] == IN_PART
    assert result(2, noise(0.0410, moved, real=0.0200))[0] == HOLDS
    assert result(2, noise(0.0280, {"hdl64e": 0.0044, "vlp16": 0.0044}))[0] == IN_PART


def test_2_names_the_models_that_it_needs() -> None:
    assert needed(2, Evidence()).endswith("with the error model hdl64e")
    for model in ("hdl64e", "vlp16"):
        lacking = needed(2, noise(0.03, {model: 0.01}))
        assert lacking.endswith("with the error models hdl64e and vlp16")


@pytest.mark.parametrize(("half", "expected"), [(0.002, HOLDS), (0.001, FAILS), (np.nan, FAILS)])
def test_3_spreads_within_the_intervals_of_repeated_scans_are_alike(
    half: float, expected: str
) -> None:
    """They differ by 2.4 mm; two half widths of 2 mm are together 2.8 mm."""
    rows = [
        (model, "all", distance, "all", 0.0, std)
        for distance in ("5", "30")
        for model, std in (("vlp16", 0.0186), ("vlp16_divergence", 0.0210))
    ]
    table = statistics(*rows).assign(std_half_m=half)
    assert result(3, Evidence(residual_statistics=table))[0] == expected


def incidence(along: Curve, off: Curve) -> Evidence:
    """Three bins, the last first."""
    low = {"low_rad": [1.2, 0.0, 0.6][: len(along)]}
    columns = {"range_error_std_m": along, "surface_distance_std_m": off}
    return Evidence(incidence_effect=pd.DataFrame({"model": "vlp16_incidence", **low, **columns}))


@pytest.mark.parametrize(("last", "expected"), [(0.0143, HOLDS), (0.0146, IN_PART)])
def test_4_the_real_residuals_rise_by_1_44_from_the_first_bin_to_the_last(
    last: float, expected: str
) -> None:
    """Half of the rise from 11.8 to 24.6 mm, in the logarithm."""
    assert result(4, incidence((0.03, 0.017, 0.01), (last, 0.01, 0.05)))[0] == expected


def test_4_needs_two_bins_of_which_the_last_has_the_greater_error() -> None:
    level = incidence((0.017, 0.017, 0.03), (0.01, 0.01, 0.01))
    assert holds(4, level, "range error rises") is False
    two = incidence((0.03, 0.017), (0.01, 0.01))
    assert result(4, two)[0] == HOLDS
    assert "range error rises: yes (0.0170 to 0.0300 m)" in result(4, two)[1]
    assert "does not: yes (0.0100 to 0.0100 m; real 0.0118 to 0.0246 m)" in result(4, two)[1]
    assert result(4, incidence((0.03,), (0.01,)))[0].startswith("not tested")


def flatness(stds: Sequence[float], counts: int = 100, far: float | None = None) -> Evidence:
    """Walls from distances of 1 m, 2 m, ... and from 30 m."""
    rows = [("vlp16_divergence", "wall", str(i + 1), "all", 0.0, s) for i, s in enumerate(stds)]
    rows += [("vlp16_divergence", "wall", "30", "all", 0.0, far)] if far else []
    rows += [("vlp16_divergence", "wall", "all", "all", 0.0, 0.1)]
    return Evidence(residual_statistics=statistics(*rows).assign(count=counts))


@pytest.mark.parametrize(
    ("odd", "flat"), [(0.0183, True), (0.0185, False), (0.0108, True), (0.0106, False)]
)
def test_5_a_spread_up_to_1_31_of_the_median_is_no_dependence(odd: float, flat: bool) -> None:
    """The ninth bin of Figure 5.15 over the median of all ten: 17.5 over 13.35 mm."""
    actual = flatness([0.0140, 0.0140, odd], far=0.09)
    assert holds(5, actual, "vlp16_divergence, wall: not on the distance") is flat


def test_5_needs_two_groups_of_a_hundred_residuals() -> None:
    statement = "vlp16_divergence, wall: not on the distance"
    assert holds(5, flatness([0.0140, 0.0141]), statement) is True
    assert holds(5, flatness([0.0140]), statement) is None
    assert holds(5, flatness([0.0140, 0.0141], counts=99), statement) is None
    assert needed(5, flatness([0.0140, 0.0141])).startswith("captures of a real VLP-16")
    real = [("real", "wall", "all", laser, 0.0, 0.014) for laser in ("0", "1")]
    real += [("real", "all", "all", "all", 0.0, 0.014)]
    captured = Evidence(residual_statistics=statistics(*real))
    assert needed(5, captured) == "captures of one wall from several distances"


@pytest.mark.parametrize(
    ("curve", "levels"),
    [((9, 5, 1.9, 1.5, 1.2, 1.0), True), ((9, 5, 2.2, 1.9, 1.2, 1.0), False)],
)
def test_6_a_curve_levels_off_whose_upper_half_does_not_halve_it(
    curve: Curve, levels: bool
) -> None:
    evidence = run({name: {"cd_plane": curve} for name in CODECS})
    assert holds(6, evidence, "PCGCv1 levels off") is levels
    assert holds(6, evidence, "Draco does not level off") is not levels


@pytest.mark.parametrize(("last", "improves"), [(1.0, False), (0.7, True)])
def test_6_a_codec_improves_when_its_last_error_is_below_its_first(
    last: float, improves: bool
) -> None:
    evidence = run({"draco": {"cd_plane": (1.0, 5.0, 0.1, 5.0, 5.0, last)}})
    assert holds(6, evidence, "Draco improves") is improves
    assert "the codec gpcc_arena" in needed(6, evidence)


def test_a_curve_without_error_or_of_one_rate_is_none() -> None:
    perfect = run({"draco": {"cd_plane": (5.0, 4.0, 3.0, 2.0, 1.0, 0.0)}})
    assert needed(6, perfect).startswith("4 rates and 4 clouds or more of Draco")
    small = run({"draco": {"cd_plane": [0.9 * value for value in (0.6, 0.5, 0.4, 0.3, 0.2, 0.1)]}})
    assert holds(6, small, "Draco improves") is True


@pytest.mark.parametrize(("rates", "clouds", "told"), [(4, 4, True), (3, 4, None), (4, 3, None)])
def test_four_rates_and_four_clouds_of_all_sets_together_make_a_curve(
    rates: int, clouds: int, told: bool | None
) -> None:
    evidence = run({name: {"cd_plane": falling(4)} for name in ("gpcc_as_run", "pcgcv2")})
    table = evidence.metrics
    assert table is not None
    number = table["cloud"].str[1:].astype(int) + 2 * (table["dataset"] == "noisy")
    some = table["dataset"].isin(["objects", "noisy"]) & (number < clouds)
    some &= (table["dataset"] == "noisy") | (number < 2)
    some &= table["rate"].isin([f"r{place + 1}" for place in range(rates)])
    few = replace(evidence, metrics=table[some])
    assert few.clouds_of(DATASETS, "gpcc_as_run", "pcgcv2") == clouds
    assert holds(6, few, "PCGCv2 improves") is told
    assert holds(7, few, "PCGCv2 matches G-PCC as run") is told
    assert holds(10, few, "PCGCv2 alike") is told


def test_clouds_count_that_every_codec_has_coded() -> None:
    evidence = run({name: {"cd_plane": falling(4)} for name in ("gpcc_as_run", "pcgcv2")})
    table = evidence.metrics
    assert table is not None
    assert evidence.clouds_of(["clean", "noisy"], "pcgcv2") == 10
    rest = table[(table["codec"] != "pcgcv2") | (table["cloud"] == "c3")]
    fewer = replace(evidence, metrics=rest)
    assert fewer.clouds_of(["clean", "noisy"], "pcgcv2", "gpcc_as_run") == 2
    assert Evidence().clouds_of(["clean"], "pcgcv2") == Evidence().calls("pcgcv2") == 0


@pytest.mark.parametrize(
    ("clouds", "repeats", "alone", "calls"),
    [
        (5, None, None, 0),
        (180, 2, False, 0),
        (5, None, True, 5),
        (4, None, True, 4),
        (2, 3, False, 6),
        (2, 3, None, 6),
    ],
)
def test_9_counts_calls_that_are_repeated_or_alone_on_the_machine(
    clouds: int, repeats: int | None, alone: bool | None, calls: int
) -> None:
    """Clouds timed once each beside other jobs have times of those jobs."""
    evidence = run({"draco": {"encode_s": BPP, "decode_s": BPP}}, clouds=clouds)
    assert evidence.metrics is not None
    if repeats:
        evidence.metrics["repeats"] = repeats
    if alone is not None:
        evidence.metrics["timed_alone"] = alone
    assert evidence.calls("draco") == calls
    assert (holds(9, evidence, "Draco grows") is None) == (calls < 5)
    assert ("5 timed calls" in needed(9, evidence)) == (calls < 5)


def beside(ratios: Sequence[float], column: str = "cd_plane", **changes: Curve) -> Evidence:
    """PCGCv2 at these ratios of G-PCC's error."""
    base = np.array(falling(4))
    more = {name: {column: tuple(base * np.array(values))} for name, values in changes.items()}
    curves = {"gpcc_as_run": {column: base}, "pcgcv2": {column: base * np.array(ratios)}}
    evidence = run(curves)
    table = evidence.metrics
    assert table is not None
    for dataset, values in more.items():
        rows = (table["dataset"] == dataset) & (table["codec"] == "pcgcv2")
        table.loc[rows, column] = np.tile(values[column], rows.sum() // len(base))
    return evidence


@pytest.mark.parametrize(
    ("ratios", "matches"),
    [
        ((1.2,) * 6, True),
        ((1.4,) * 6, False),
        ((2.0, 1.1, 1.1, 9, 9, 9), True),
        ((1.1, 1.4, 1.4, 0.1, 0.1, 0.1), False),
    ],
)
def test_7_a_codec_matches_within_a_decibel_over_the_lower_half_of_its_rates(
    ratios: Sequence[float], matches: bool
) -> None:
    assert holds(7, beside(ratios), "PCGCv2 matches G-PCC as run") is matches


def test_7_needs_bits_that_both_can_do_with() -> None:
    evidence = beside((1.0,) * 6)
    table = evidence.metrics
    assert table is not None
    table.loc[table["codec"] == "pcgcv2", "bpp"] *= 1000
    assert "4 rates of both, 3 of them in a common range, and 4 clouds" in needed(7, evidence)


@pytest.mark.parametrize(("place", "is_told"), [(2, False), (3, True)])
def test_at_equal_bits_three_rates_are_compared_at_least(place: int, is_told: bool) -> None:
    """Whole curves of six rates, of which fewer lie within the other's range of bits."""
    evidence = beside((1.0,) * 6)
    table = evidence.metrics
    assert table is not None
    table.loc[table["codec"] == "pcgcv2", "bpp"] *= BPP[-1] / BPP[place - 1] * 0.999
    for number, says in ((7, "matches"), (11, "loses to")):
        actual = holds(number, evidence, f"PCGCv2 {says} G-PCC as run")
        assert (actual is not None) is is_told


def test_every_part_shows_its_sample() -> None:
    rows = [
        (model, surface, distance, laser, 0.0, 0.014)
        for model in ("real", "hdl64e", "vlp16", "vlp16_divergence")
        for surface in ("all", "wall", "floor")
        for distance in ("all", "1", "5", "30")
        for laser in ("all", "0", "1")
    ]
    sensor = replace(
        noise(0.03, {"hdl64e": 0.04, "vlp16": 0.0044}),
        residual_statistics=statistics(*rows),
        incidence_effect=incidence((0.03, 0.017), (0.01, 0.01)).incidence_effect,
    )
    assert sensor.incidence_effect is not None
    sensor.incidence_effect["count"] = [70, 30]
    growing = times({"draco": 2, "gpcc_as_run": 9})
    rooms = run({"draco": {"cd_plane": falling(4)}}, datasets=["rooms"], clouds=16)
    assert rooms.metrics is not None
    rooms.metrics["elongation"] = 0.5
    counts = pd.DataFrame({"dataset": ["rooms", "noisy"] * 4, "points": range(8)})
    wanted_samples = {
        1: (sensor, "500 residuals"), 2: (sensor, "500 residuals"),
        3: (sensor, "1,000 residuals"), 4: (sensor, "100 residuals"),
        5: (sensor, "1,000 residuals, 2 "), 9: (growing, "Draco 20 clouds, 6 rates, 15 timed"),
        12: (duplicates(2.2, 0.9), "10 clouds"), 13: (rooms, "16 rooms, 6 rates"),
        14: (Evidence(clouds=counts, datasets=DATASETS), "4 and 4 clouds"),
    }  # fmt: skip
    for number, (evidence, sample) in wanted_samples.items():
        parts = [part for part in CLAIMS[number - 1].test(evidence) if part.holds is not None]
        assert parts
        assert all(part.sample for part in parts)
        assert sample in parts[-1 if number != 2 else 0].sample


@pytest.mark.parametrize(("last", "loses"), [(1.5, True), (1.0, False), (0.9, False)])
def test_11_the_highest_rate_decides(last: float, loses: bool) -> None:
    ratios = (0.5, 0.5, 0.5, 0.5, 0.5, last) if loses else (3, 3, 3, 3, 3, last)
    assert holds(11, beside(ratios), "PCGCv2 loses to G-PCC as run") is loses


@pytest.mark.parametrize(("ratio", "lags"), [(1.5, True), (1.0, False), (0.9, False)])
def test_8_a_codec_lags_whose_median_ratio_is_above_one(ratio: float, lags: bool) -> None:
    evidence = beside((ratio, ratio, ratio, ratio, 9, 0.1), "hausdorff_sq_plane")
    assert holds(8, evidence, "PCGCv2 lags behind G-PCC as run") is lags
    assert holds(8, evidence, "PCGCv2 lags more on scans") is False


def test_8_lags_more_on_scans_than_on_objects_on_every_set() -> None:
    column, statement = "hausdorff_sq_plane", "PCGCv2 lags more on scans"
    more = {"clean": (3.0,) * 6, "noisy": (2.0,) * 6}
    assert holds(8, beside((1.5,) * 6, column, **more), statement) is True
    assert holds(8, beside((2.5,) * 6, column, **more), statement) is False
    for kinds in (["objects"], ["clean"]):
        evidence = beside((1.5,) * 6, column)
        alone = replace(evidence, datasets={name: DATASETS[name] for name in kinds})
        assert "an object set and scans" in needed(8, alone)


def times(growth: Mapping[str, float]) -> Evidence:
    names = ("encode_s", "decode_s")
    evidence = run(
        {k: {name: np.geomspace(1, v, len(BPP)) for name in names} for k, v in growth.items()}
    )
    assert evidence.metrics is not None
    return replace(evidence, metrics=evidence.metrics.assign(repeats=3))


def test_9_hardly_is_up_to_17_over_11() -> None:
    slow = times({"draco": 1.6, "pcgcv2": 1.6})
    assert holds(9, slow, "Draco grows") is True
    assert holds(9, slow, "PCGCv2 hardly grows") is False
    fast = times({"draco": 1.5, "pcgcv2": 1.5})
    assert holds(9, fast, "Draco grows") is False
    assert holds(9, fast, "PCGCv2 hardly grows") is True


def test_9_the_most_is_among_several_codecs_of_which_one_is_gpcc() -> None:
    statement = "G-PCC grows most"
    assert holds(9, times({"gpcc_as_run": 9, "draco": 3}), statement) is True
    assert holds(9, times({"gpcc_as_run": 2, "gpcc": 9, "draco": 3}), statement) is True
    assert holds(9, times({"gpcc_as_run": 2, "draco": 3}), statement) is False
    assert holds(9, times({"gpcc_as_run": 9}), statement) is None
    assert holds(9, times({"gpcc": 9, "draco": 3}), statement) is None


@pytest.mark.parametrize(
    ("factors", "alike"),
    [
        ((1.9,) * 6, True),
        ((2.2,) * 6, False),
        ((1, 1, 1, 1, 9, 9), True),
        ((9, 9, 9, 9, 1, 1), False),
    ],
)
def test_10_alike_is_within_a_factor_of_two_at_most_rates(
    factors: Sequence[float], alike: bool
) -> None:
    changed = {"cd_plane": np.array(falling(4)) * factors}
    names = ["objects", "noisy"]
    evidence = run({"draco": {"cd_plane": falling(4)}}, datasets=names, noisy=changed)
    assert holds(10, evidence, "Draco alike") is alike
    for name in names:
        alone = replace(evidence, datasets={name: DATASETS[name]})
        assert needed(10, alone) == "scans and a data set of another kind"


def duplicates(scan_bpp: float, scan_share: float, rate: str = "r1") -> Evidence:
    """Draco on objects, half of whose points fall together, and on scans: so many, at one rate."""
    evidence = run({"draco": {"cd_plane": falling(4)}}, datasets=["objects", "noisy"])
    table = evidence.metrics
    assert table is not None
    scan = table["dataset"] == "noisy"
    table["bpp"] *= np.where(scan, scan_bpp, 1)
    table["points_out"] = 1000
    table["points_b"] = (
        np.where(scan, np.where(table["rate"] == rate, 1 - scan_share, 1), 0.5) * 1000
    )
    return evidence


@pytest.mark.parametrize(
    ("bpp", "share", "expected"),
    [(2.2, 0.556, HOLDS), (2.2, 0.545, IN_PART), (1.9, 0.556, IN_PART), (1.9, 0.4, FAILS)],
)
def test_12_twice_the_bits_and_a_twentieth_more_duplicates(
    bpp: float, share: float, expected: str
) -> None:
    assert result(12, duplicates(bpp, share))[0] == expected


def test_12_is_of_the_first_rate_of_draco_on_objects_and_scans() -> None:
    assert result(12, duplicates(2.2, 0.9, rate="r6"))[0] == IN_PART
    evidence = duplicates(2.2, 0.9)
    for name in ("objects", "noisy"):
        alone = replace(evidence, datasets={name: DATASETS[name]})
        assert needed(12, alone) == "an object set and scans"
    assert needed(12, replace(evidence, codecs={})) == "the codec draco"
    assert evidence.metrics is not None
    uncounted = replace(evidence, metrics=evidence.metrics.drop(columns="points_b"))
    assert needed(12, uncounted) == "counts of the decoded points"


@pytest.mark.parametrize(("reversed_", "none"), [(12, False), (13, True)])
@pytest.mark.parametrize("sign", [1, -1])
def test_13_a_rank_correlation_of_a_half_is_visible(reversed_: int, none: bool, sign: int) -> None:
    """Twenty ranks of which the first m are reversed: 1 - 2 m (m^2 - 1) / (20 * 399)."""
    evidence = run({"draco": {"cd_plane": falling(4)}}, datasets=["rooms"], clouds=20)
    table = evidence.metrics
    assert table is not None
    order = np.concatenate([np.arange(reversed_)[::-1], np.arange(reversed_, 20)])
    number = table["cloud"].str[1:].astype(int)
    table["elongation"] = number / 20
    table["cd_plane"] = 100 + sign * order[number]
    assert holds(13, evidence, "Draco: none") is none


def test_13_sixteen_rooms_are_enough_and_rooms_all_alike_have_no_effect() -> None:
    evidence = run({"draco": {"cd_plane": falling(4)}}, datasets=["rooms"], clouds=16)
    assert evidence.metrics is not None
    evidence.metrics["elongation"] = 0.5
    assert holds(13, evidence, "Draco: none") is True
    assert "the codec gpcc" in needed(13, evidence)


@pytest.mark.parametrize(
    ("scans", "narrower", "higher"),
    [
        ((1000, 1000, 1000, 1999), True, True),
        ((0, 1200, 1200, 1210), False, True),
        ((500, 700, 900, 1100), False, False),
        ((790, 800, 801, 810), True, True),
    ],
)
def test_14_quartiles_and_medians_of_point_counts(
    scans: Sequence[int], narrower: bool, higher: bool
) -> None:
    counts = {"rooms": (500, 700, 900, 1100), "noisy": scans}
    rows = [{"dataset": name, "points": n} for name, values in counts.items() for n in values]
    evidence = Evidence(clouds=pd.DataFrame(rows), datasets={k: DATASETS[k] for k in counts})
    assert holds(14, evidence, "noisy narrower than rooms") is narrower
    assert holds(14, evidence, "noisy higher than rooms") is higher
    fewer = replace(evidence, clouds=pd.DataFrame(rows[:-1]))
    assert needed(14, fewer).startswith("captured rooms as clouds")


def test_a_base_of_three_rates_tells_nothing() -> None:
    evidence = beside((1.0,) * 6)
    table = evidence.metrics
    assert table is not None
    for rates, ratios in ((["r2", "r3", "r4"], 0), (["r2", "r3", "r4", "r5"], 4)):
        few = table[(table["codec"] == "pcgcv2") | table["rate"].isin(rates)]
        shuffled = few.sample(frac=1, random_state=1)
        actual = replace(evidence, metrics=shuffled).at_equal_rate(
            "objects", "pcgcv2", "gpcc_as_run", "cd_plane"
        )
        np.testing.assert_allclose(actual["ratio"], np.ones(ratios))


def test_the_thesis_s_rates_are_those_of_its_figure() -> None:
    assert set(medians_of_thesis()["rate"]) <= RATES
    assert len(RATES) == 8


def test_without_results_no_claim_is_tested() -> None:
    evidence = Evidence(datasets=DATASETS, codecs=CODECS)
    for claim in CLAIMS:
        assert [part.holds for part in claim.test(evidence) if part.holds is not None] == []


def test_what_was_found_is_told_in_numbers() -> None:
    actual = {part.statement: part.measured for part in CLAIMS[11].test(duplicates(2.5, 0.9))}
    assert actual["shifted to more bits on scans"] == "objects 0.1 to 3.2 bpp, noisy 0.25 to 8 bpp"
    assert actual["more points fall together there at the first rate"] == (
        "objects 50.00%, noisy 90.00%"
    )


def test_14_a_median_that_is_equal_is_not_higher() -> None:
    counts = {"rooms": (500, 700, 900, 1100), "noisy": (790, 800, 800, 810)}
    rows = [{"dataset": name, "points": n} for name, values in counts.items() for n in values]
    evidence = Evidence(clouds=pd.DataFrame(rows), datasets={k: DATASETS[k] for k in counts})
    assert holds(14, evidence, "noisy higher than rooms") is False


def test_10_a_codec_on_one_data_set_is_not_compared() -> None:
    curves = {"draco": {"cd_plane": falling(4)}, "gpcc": {"cd_plane": falling(4)}}
    evidence = run(curves, datasets=["objects", "noisy"])
    assert evidence.metrics is not None
    alone = (evidence.metrics["codec"] == "gpcc") & (evidence.metrics["dataset"] == "noisy")
    evidence = replace(evidence, metrics=evidence.metrics[~alone])
    assert holds(10, evidence, "Draco alike") is True
    assert holds(10, evidence, "G-PCC, rounded alike") is None
    actual = {part.statement: part.measured for part in CLAIMS[9].test(evidence)}
    assert actual["Draco alike"] == "CD differs 1 times at one rate, median 1"
    evidence = times({"draco": 3, "gpcc": 9})
    actual = {part.statement: part.measured for part in CLAIMS[8].test(evidence)}
    assert actual["Draco grows"] == "3 times the time, median 3"


def test_12_tells_on_how_many_clouds_it_was_tested() -> None:
    samples = {part.statement: part.sample for part in CLAIMS[11].test(duplicates(2.5, 0.9))}
    assert samples["shifted to more bits on scans"] == "10 clouds"
