"""Claims about rate, distortion and time (thesis section 6.2). CD is the Chamfer distance."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from jenco2022.claims.evidence import MIN_CALLS, MIN_CLOUDS, MIN_COMMON_RATES, MIN_RATES, Evidence
from jenco2022.claims.verdicts import Part, untested
from jenco2022.published import (
    CLASSICAL,
    DATASETS,
    DRACO,
    GPCC,
    GPCC_AS_RUN,
    LEARNED,
    OBJECTS,
    PCGCV1,
    PCGCV2,
    SCANS,
)
from pointkit.geometry.cloud import Floats
from puckbench.metrics.timing import MIN_REPEATS

TITLES = {
    DRACO: "Draco",
    GPCC: "G-PCC, rounded",
    GPCC_AS_RUN: "G-PCC as run",
    PCGCV1: "PCGCv1",
    PCGCV2: "PCGCv2",
}
CODEC_NEEDS = {
    DRACO: "the codec draco",
    GPCC: "the codec gpcc",
    GPCC_AS_RUN: "the codec gpcc_arena",
    PCGCV1: "the codec pcgcv1 with its authors' weights",
    PCGCV2: "the codec pcgcv2 with its authors' weights",
}
TWICE = 2.0
"""Ratio of squared distances that counts as a large change, 3 dB.

Halving the grid's step divides squared distances by four.
"""
ONE_DB = 1.26
"""Ratio of squared distances that counts as equal: 1 dB, the size of a marker in Figure 6.6."""
MUCH_LESS_AFFECTED = 17 / 11
"""Factor by which the time of PCGCv2 grows in the thesis's Figure 6.5, from 11 to 17 s."""
COMPARISON_NEEDS = (
    f"{MIN_RATES} rates of both, {MIN_COMMON_RATES} of them in a common range, "
    f"and {MIN_CLOUDS} clouds"
)
TIME_NEEDS = (
    f"{MIN_CALLS} timed calls for each rate and data set, of clouds timed {MIN_REPEATS} times "
    "(timing: repeats) or alone on the machine"
)


def improves_and_levels_off(evidence: Evidence) -> list[Part]:
    """Test whether CD improves with the rate, and levels off for all codecs but Draco.

    This is claim 6 of the thesis. It holds for a codec if CD is lower at the last rate than at the
    first and, except for Draco, falls by a factor below `TWICE` over the upper half of the rates.
    """
    parts = []
    for codec in (*CLASSICAL, *LEARNED):
        curves = _curves(evidence, codec, "cd_plane")
        if not curves:
            parts.append(_untested(evidence, codec))
            continue
        falls = [curve[0] / curve[-1] for curve in curves]
        upper_falls = [curve[(len(curve) - 1) // 2] / curve[-1] for curve in curves]
        improved = f"CD falls {_times(falls)} from first to last rate"
        sample = _sample(evidence, evidence.with_role(*DATASETS), [codec])
        parts.append(Part(f"{TITLES[codec]} improves", min(falls) > 1, improved, sample=sample))
        shape = "does not level off" if codec == DRACO else "levels off"
        holds = min(upper_falls) >= TWICE if codec == DRACO else max(upper_falls) < TWICE
        measured = f"CD falls {_times(upper_falls)} over the upper half of the rates"
        parts.append(Part(f"{TITLES[codec]} {shape}", holds, measured, sample=sample))
    return parts


def learned_match_at_low_rates(evidence: Evidence) -> list[Part]:
    """Test whether learned codecs are as good as classical codecs at low rates.

    This is claim 7 of the thesis. It holds if, over the lower half of a learned codec's rates, the
    median ratio of learned to classical CD at equal bits is at most `ONE_DB`.
    """
    return _comparisons(evidence, "cd_plane", "matches", _lower_half, lambda ratio: ratio <= ONE_DB)


def gpcc_wins_at_high_rates(evidence: Evidence) -> list[Part]:
    """Test whether G-PCC is better than learned codecs at high rates.

    This is claim 11 of the thesis. It holds if, at the learned codec's highest rate within G-PCC's
    range of bits, its CD is greater than that of G-PCC at equal bits.
    """
    return _comparisons(
        evidence, "cd_plane", "loses to", _last, lambda ratio: ratio > 1, (GPCC_AS_RUN, GPCC)
    )


def learned_lag_in_hausdorff(evidence: Evidence) -> list[Part]:
    """Test whether learned codecs have greater Hausdorff distances than G-PCC, above all on scans.

    This is claim 8 of the thesis. It holds if the median ratio of a learned codec's squared
    Hausdorff distance to that of G-PCC at equal bits is above 1, and is greater on scans than on
    objects.
    """
    evidence = evidence.with_stand_ins()
    column, bases = "hausdorff_sq_plane", (GPCC_AS_RUN, GPCC)
    parts = _comparisons(evidence, column, "lags behind", np.median, lambda ratio: ratio > 1, bases)
    objects, scans = evidence.with_role(OBJECTS), evidence.with_role(*SCANS)
    for codec in LEARNED:
        if codec not in evidence.codecs:
            continue
        ratios = _ratios(evidence, codec, GPCC_AS_RUN, column, [*objects, *scans])
        on_objects, on_scans = (
            [float(np.median(ratios[name])) for name in names if name in ratios]
            for names in (objects, scans)
        )
        if not on_objects or not on_scans:
            need = "an object set and scans, coded by gpcc_arena as well"
            parts.append(untested(f"{need}, with {COMPARISON_NEEDS}"))
            continue
        measured = f"{_times(on_scans)} G-PCC's on scans, {_times(on_objects)} on objects"
        lags_more = min(on_scans) > max(on_objects)
        stand_in = evidence.stand_in(codec)
        statement = f"{stand_in or TITLES[codec]} lags more on scans"
        sample = _sample(evidence, ratios, [codec, GPCC_AS_RUN], map(len, ratios.values()))
        parts.append(Part(statement, lags_more, measured, stand_in, sample))
    return parts


def time_grows(evidence: Evidence) -> list[Part]:
    """Test whether times grow with the rate, least for PCGCv2 and most for G-PCC.

    This is claim 9 of the thesis. It holds if the time at the last rate, divided by the time at the
    first rate, is at most `MUCH_LESS_AFFECTED` for PCGCv2, greater for other codecs, and greatest
    for G-PCC.
    """
    parts, growths, samples = [], {}, []
    for codec in (DRACO, GPCC_AS_RUN, GPCC, PCGCV1, PCGCV2):
        ratios = _time_ratios(evidence, codec)
        if not ratios:
            parts.append(_untested(evidence, codec))
            continue
        calls = evidence.calls(codec)
        if calls < MIN_CALLS:
            parts.append(untested(TIME_NEEDS))
            continue
        growths[codec] = float(np.median(ratios))
        grows = "hardly grows" if codec == PCGCV2 else "grows"
        holds = (growths[codec] > MUCH_LESS_AFFECTED) != (codec == PCGCV2)
        measured = f"{_times(ratios)} the time, median {growths[codec]:.3g}"
        sample = _sample(evidence, evidence.with_role(*DATASETS), [codec])
        sample += f", {calls} timed calls for each"
        samples.append(f"{TITLES[codec]} {sample}")
        parts.append(Part(f"{TITLES[codec]} {grows}", holds, measured, sample=sample))
    if len(growths) > 1 and GPCC_AS_RUN in growths:
        most = max(growths, key=lambda codec: growths[codec])
        measured = f"{TITLES[most]} grows most, {growths[most]:.3g} times"
        is_gpcc, sample = most in (GPCC, GPCC_AS_RUN), "; ".join(samples)
        parts.append(Part("G-PCC grows most", is_gpcc, measured, sample=sample))
    return parts


def alike_on_all_data(evidence: Evidence) -> list[Part]:
    """Test whether CD is similar on all data sets at the same rate.

    This is claim 10 of the thesis. At each rate, the largest median CD of a data set is divided by
    the smallest. The claim holds for a codec if the median of these ratios over rates is below
    `TWICE`.
    """
    measured_datasets = evidence.measured_datasets & set(evidence.datasets)
    kinds = {evidence.datasets[name] for name in measured_datasets}
    if not kinds & set(SCANS) or len(kinds) < 2:
        return [untested("scans and a data set of another kind")]
    parts = []
    for codec in (*CLASSICAL, *LEARNED):
        curves = _curves(evidence, codec, "cd_plane")
        if len(curves) < 2:
            parts.append(_untested(evidence, codec))
            continue
        rates = min(map(len, curves))
        table = np.array([curve[:rates] for curve in curves])
        ratios = table.max(axis=0) / table.min(axis=0)
        measured = f"CD differs {_times(ratios)} at one rate, median {np.median(ratios):.2g}"
        is_alike = bool(np.median(ratios) < TWICE)
        sample = _sample(evidence, evidence.with_role(*DATASETS), [codec])
        parts.append(Part(f"{TITLES[codec]} alike", is_alike, measured, sample=sample))
    return parts


def _untested(evidence: Evidence, codec: str) -> Part:
    if codec not in evidence.codecs:
        return untested(CODEC_NEEDS[codec])
    return untested(f"{MIN_RATES} rates and {MIN_CLOUDS} clouds or more of {TITLES[codec]}")


def _sample(
    evidence: Evidence, datasets: Iterable[str], codecs: Sequence[str], rates: Iterable[int] = ()
) -> str:
    if evidence.of_medians:
        return ""
    counts = list(rates) or [
        len(evidence.rates(name, codec, "bpp")) for name in datasets for codec in codecs
    ]
    least, most = min(counts), max(counts)
    numbers = f"{most}" if least == most else f"{least} to {most}"
    clouds = evidence.clouds_of(datasets, *codecs)
    return f"{clouds} clouds, {numbers} rate{'s' if most > 1 else ''}"


def _curves(evidence: Evidence, codec: str, column: str) -> list[Floats]:
    if codec not in evidence.codecs or not evidence.has_enough_clouds(evidence.datasets, codec):
        return []
    curves = [evidence.rates(name, codec, column) for name in evidence.datasets]
    return [curve for curve in curves if len(curve) >= MIN_RATES and curve.min() > 0]


def _time_ratios(evidence: Evidence, codec: str) -> list[float]:
    curves = [
        curve for column in ("encode_s", "decode_s") for curve in _curves(evidence, codec, column)
    ]
    return [curve[-1] / curve[0] for curve in curves]


def _comparisons(
    evidence: Evidence,
    column: str,
    relation: str,
    summary: Callable[[Floats], float],
    holds: Callable[[float], bool],
    bases: Sequence[str] = CLASSICAL,
) -> list[Part]:
    """Return the test result for each pair of a learned codec and a codec in `bases`.

    A result is positive if, on every data set, `holds` is true for the `summary` of the ratios
    (learned codec over base) of `column` at equal bits. `relation` states the comparison in words.
    """
    evidence, parts = evidence.with_stand_ins(), []
    for codec in LEARNED:
        for base in bases:
            absent = [role for role in (codec, base) if role not in evidence.codecs]
            ratios = _ratios(evidence, codec, base, column, list(evidence.datasets))
            if absent or not ratios:
                parts.append(untested(CODEC_NEEDS[absent[0]] if absent else COMPARISON_NEEDS))
                continue
            summaries = {name: float(summary(values)) for name, values in ratios.items()}
            text = ", ".join(f"{name} {ratio:.3g}" for name, ratio in summaries.items())
            stand_in = evidence.stand_in(codec)
            statement = f"{stand_in or TITLES[codec]} {relation} {TITLES[base]}"
            all_hold = all(map(holds, summaries.values()))
            sample = _sample(evidence, ratios, [codec, base], map(len, ratios.values()))
            measured = f"ratio at equal bpp: {text}"
            parts.append(Part(statement, all_hold, measured, stand_in, sample))
    return parts


def _ratios(
    evidence: Evidence, codec: str, base: str, column: str, datasets: Sequence[str]
) -> dict[str, Floats]:
    tables = {name: evidence.at_equal_rate(name, codec, base, column) for name in datasets}
    ratios = {
        name: table["ratio"].to_numpy(dtype=float) for name, table in tables.items() if len(table)
    }
    return ratios if evidence.has_enough_clouds(ratios, codec, base) else {}


def _lower_half(ratios: Floats) -> float:
    return float(np.median(ratios[: (len(ratios) + 1) // 2]))


def _last(ratios: Floats) -> float:
    return float(ratios[-1])


def _times(factors: Sequence[float] | Floats) -> str:
    low, high = f"{min(factors):.3g}", f"{max(factors):.3g}"
    return f"{low} times" if low == high else f"{low} to {high} times"
