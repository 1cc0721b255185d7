"""The thesis's claims about rate, distortion and time (section 6.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.thesis.claims.evidence import (
    LEAST_CALLS,
    LEAST_CLOUDS,
    LEAST_COMPARED,
    LEAST_RATES,
    LEAST_REPEATS,
    Evidence,
)
from puckbench.thesis.claims.parts import Part, needs
from puckbench.thesis.claims.roles import (
    CLASSICAL,
    DATASETS,
    DRACO,
    GPCC,
    GPCC_AS_RUN,
    LEARNED,
    PCGCV1,
    PCGCV2,
    SCANS,
)
from puckbench.thesis.published_rates import OBJECTS

TITLES = {
    DRACO: "Draco",
    GPCC: "G-PCC, rounded",
    GPCC_AS_RUN: "G-PCC as run",
    PCGCV1: "PCGCv1",
    PCGCV2: "PCGCv2",
}
WANTED = {
    DRACO: "the codec draco",
    GPCC: "the codec gpcc",
    GPCC_AS_RUN: "the codec gpcc_arena",
    PCGCV1: "the codec pcgcv1 with its authors' weights",
    PCGCV2: "the codec pcgcv2 with its authors' weights",
}
TWICE = 2.0
"""Of a squared distance: 3 dB, a third of a decade on the thesis's axes. Half the effect of one
step of a codec whose error is its step's, which is four."""
ONE_DB = 1.26
"""Of a squared distance; on the axes of Figure 6.6 the width of a marker."""
HARDLY_SLOWER = 17 / 11
"""What the thesis calls "much less affected": PCGCv2 takes 11 to 17 s in its Figure 6.5."""
COMMON = (
    f"{LEAST_RATES} rates of both, {LEAST_COMPARED} of them in a common range, "
    f"and {LEAST_CLOUDS} clouds"
)
CALLS = (
    f"{LEAST_CALLS} timed calls for each rate and data set, of clouds timed {LEAST_REPEATS} times "
    "(timing: repeats) or alone on the machine"
)

_Test = Callable[[Evidence, str], Part]


def improves_and_levels_off(evidence: Evidence) -> list[Part]:
    """Claim 6: CD improves with the rate for all codecs, and all but Draco level off.

    A codec improves when on every data set its median CD is lower at the last rate than at the
    first. It levels off when on none the upper half of its rates halves its CD (`TWICE`), and does
    not when on each it does: the grid's step alone divides it by four from scale 1/2 to 1.
    """
    parts = []
    for codec in (*CLASSICAL, *LEARNED):
        curves = _curves(evidence, codec, "cd_plane")
        if not curves:
            parts.append(_lacking(evidence, codec))
            continue
        whole = [curve[0] / curve[-1] for curve in curves]
        upper = [curve[(len(curve) - 1) // 2] / curve[-1] for curve in curves]
        improved = f"CD falls {_times(whole)} from first to last rate"
        sample = _sample(evidence, evidence.named(*DATASETS), [codec])
        parts.append(Part(f"{TITLES[codec]} improves", min(whole) > 1, improved, sample=sample))
        says = "does not level off" if codec == DRACO else "levels off"
        holds = min(upper) >= TWICE if codec == DRACO else max(upper) < TWICE
        found = f"CD falls {_times(upper)} over the upper half of the rates"
        parts.append(Part(f"{TITLES[codec]} {says}", holds, found, sample=sample))
    return parts


def learned_match_at_low_rates(evidence: Evidence) -> list[Part]:
    """Claim 7: at low rates the learned codecs match or beat the classical ones.

    Compared at equal bits per point. A learned codec matches another when, over the lower half
    of its rates (those within the other's range), the median of its CD over the other's is below
    1 dB (`ONE_DB`) on every data set. What puckbench makes of a learned codec stands in for it
    where it is absent, and the verdict says so.
    """
    return _beside(evidence, "cd_plane", "matches", _lower_half, lambda ratio: ratio <= ONE_DB)


def gpcc_wins_at_high_rates(evidence: Evidence) -> list[Part]:
    """Claim 11: G-PCC beats the learned codecs once the bitrate rises.

    At the learned codec's highest rate within G-PCC's range, its CD is above G-PCC's at equal
    bits per point, on every data set. Stand-ins as for claim 7.
    """
    return _beside(
        evidence, "cd_plane", "loses to", _last, lambda ratio: ratio > 1, (GPCC_AS_RUN, GPCC)
    )


def learned_lag_in_hausdorff(evidence: Evidence) -> list[Part]:
    """Claim 8: in the Hausdorff distance the learned codecs lag, more so on scans.

    Against G-PCC at equal bits per point, the median over the rates of the ratio of the squared
    distances. A codec lags when the ratio is above 1 on every data set; more so on scans when the
    least ratio on scans is above that on objects. Stand-ins as for claim 7.
    """
    evidence = evidence.with_stand_ins()
    column, bases = "hausdorff_sq_plane", (GPCC_AS_RUN, GPCC)
    parts = _beside(evidence, column, "lags behind", np.median, lambda ratio: ratio > 1, bases)
    objects, scans = evidence.named(OBJECTS), evidence.named(*SCANS)
    for codec in LEARNED:
        if codec not in evidence.codecs:
            continue
        ratios = _ratios(evidence, codec, GPCC_AS_RUN, column, [*objects, *scans])
        on_objects, on_scans = (
            [float(np.median(ratios[name])) for name in names if name in ratios]
            for names in (objects, scans)
        )
        if not on_objects or not on_scans:
            both = "an object set and scans, coded by gpcc_arena as well"
            parts.append(needs(f"{both}, with {COMMON}"))
            continue
        text = f"{_times(on_scans)} G-PCC's on scans, {_times(on_objects)} on objects"
        more = min(on_scans) > max(on_objects)
        other = evidence.stand_in(codec)
        statement = f"{other or TITLES[codec]} lags more on scans"
        sample = _sample(evidence, ratios, [codec, GPCC_AS_RUN], map(len, ratios.values()))
        parts.append(Part(statement, more, text, other, sample))
    return parts


def time_grows(evidence: Evidence) -> list[Part]:
    """Claim 9: times grow with the rate for Draco, G-PCC and PCGCv1, hardly for PCGCv2, G-PCC most.

    A codec's growth is its median time at the last rate over that at the first, and of that the
    median over encoding, decoding and the data sets. "Hardly" is up to `HARDLY_SLOWER`. G-PCC grows
    most when the greatest growth is its own. A codec counts with `LEAST_CALLS` timed calls or more
    for each rate and data set, of clouds timed `LEAST_REPEATS` times or alone on the machine.
    """
    parts, most, samples = [], {}, []
    for codec in (DRACO, GPCC_AS_RUN, GPCC, PCGCV1, PCGCV2):
        growth = _growth(evidence, codec)
        if not growth:
            parts.append(_lacking(evidence, codec))
            continue
        calls = evidence.calls(codec)
        if calls < LEAST_CALLS:
            parts.append(needs(CALLS))
            continue
        most[codec] = float(np.median(growth))
        says = "hardly grows" if codec == PCGCV2 else "grows"
        holds = (most[codec] > HARDLY_SLOWER) != (codec == PCGCV2)
        found = f"{_times(growth)} the time, median {most[codec]:.3g}"
        sample = _sample(evidence, evidence.named(*DATASETS), [codec])
        sample += f", {calls} timed calls for each"
        samples.append(f"{TITLES[codec]} {sample}")
        parts.append(Part(f"{TITLES[codec]} {says}", holds, found, sample=sample))
    if len(most) > 1 and GPCC_AS_RUN in most:
        top = max(most, key=lambda codec: most[codec])
        found = f"{TITLES[top]} grows most, {most[top]:.3g} times"
        is_gpcc, sample = top in (GPCC, GPCC_AS_RUN), "; ".join(samples)
        parts.append(Part("G-PCC grows most", is_gpcc, found, sample=sample))
    return parts


def alike_on_all_data(evidence: Evidence) -> list[Part]:
    """Claim 10: CD behaves alike on S3DIS, its scans and CAPOD.

    At each rate the greatest median CD of the data sets over the least; a codec behaves alike
    when the median of that over the rates is below `TWICE`. It takes scans and one set of another
    kind.
    """
    kinds = {evidence.datasets[name] for name in evidence.has & set(evidence.datasets)}
    if not kinds & set(SCANS) or len(kinds) < 2:
        return [needs("scans and a data set of another kind")]
    parts = []
    for codec in (*CLASSICAL, *LEARNED):
        curves = _curves(evidence, codec, "cd_plane")
        if len(curves) < 2:
            parts.append(_lacking(evidence, codec))
            continue
        least = min(map(len, curves))
        table = np.array([curve[:least] for curve in curves])
        apart = table.max(axis=0) / table.min(axis=0)
        found = f"CD differs {_times(apart)} at one rate, median {np.median(apart):.2g}"
        alike, sample = (
            bool(np.median(apart) < TWICE),
            _sample(evidence, evidence.named(*DATASETS), [codec]),
        )
        parts.append(Part(f"{TITLES[codec]} alike", alike, found, sample=sample))
    return parts


def _lacking(evidence: Evidence, codec: str) -> Part:
    """What a codec's part needs: the codec itself, or more of its results."""
    if codec not in evidence.codecs:
        return needs(WANTED[codec])
    return needs(f"{LEAST_RATES} rates and {LEAST_CLOUDS} clouds or more of {TITLES[codec]}")


def _sample(
    evidence: Evidence, datasets: Iterable[str], codecs: Sequence[str], rates: Iterable[int] = ()
) -> str:
    """On how many clouds, and at how many rates of each data set, codecs were measured."""
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
    """Positive medians per rate of each data set where a codec has enough rates and clouds."""
    if codec not in evidence.codecs or not evidence.enough_clouds(evidence.datasets, codec):
        return []
    found = [evidence.rates(name, codec, column) for name in evidence.datasets]
    return [curve for curve in found if len(curve) >= LEAST_RATES and curve.min() > 0]


def _growth(evidence: Evidence, codec: str) -> list[float]:
    """Last over first time, encoding and decoding, of each data set."""
    curves = [
        curve for column in ("encode_s", "decode_s") for curve in _curves(evidence, codec, column)
    ]
    return [curve[-1] / curve[0] for curve in curves]


def _beside(
    evidence: Evidence,
    column: str,
    says: str,
    summary: Callable[[Floats], float],
    holds: Callable[[float], bool],
    bases: Sequence[str] = CLASSICAL,
) -> list[Part]:
    """A part for each learned codec beside each base: whether `holds` of every data set's ratio."""
    evidence, parts = evidence.with_stand_ins(), []
    for codec in LEARNED:
        for base in bases:
            lacking = [role for role in (codec, base) if role not in evidence.codecs]
            ratios = _ratios(evidence, codec, base, column, list(evidence.datasets))
            if lacking or not ratios:
                wanted = WANTED[lacking[0]] if lacking else COMMON
                parts.append(needs(wanted))
                continue
            found = {name: float(summary(some)) for name, some in ratios.items()}
            sets = ", ".join(f"{name} {ratio:.3g}" for name, ratio in found.items())
            other = evidence.stand_in(codec)
            statement = f"{other or TITLES[codec]} {says} {TITLES[base]}"
            ok = all(map(holds, found.values()))
            sample = _sample(evidence, ratios, [codec, base], map(len, ratios.values()))
            parts.append(Part(statement, ok, f"ratio at equal bpp: {sets}", other, sample))
    return parts


def _ratios(
    evidence: Evidence, codec: str, base: str, column: str, datasets: Sequence[str]
) -> dict[str, Floats]:
    """The ratios at equal bits per point of each data set that has some, if clouds are enough."""
    tables = {name: evidence.at_equal_rate(name, codec, base, column) for name in datasets}
    found = {name: table["ratio"].to_numpy(dtype=float) for name, table in tables.items()}
    found = {name: ratios for name, ratios in found.items() if len(ratios)}
    return found if evidence.enough_clouds(found, codec, base) else {}


def _lower_half(ratios: Floats) -> float:
    return float(np.median(ratios[: (len(ratios) + 1) // 2]))


def _last(ratios: Floats) -> float:
    return float(ratios[-1])


def _times(factors: Sequence[float] | Floats) -> str:
    """The range of some factors in words."""
    low, high = f"{min(factors):.3g}", f"{max(factors):.3g}"
    return f"{low} times" if low == high else f"{low} to {high} times"
