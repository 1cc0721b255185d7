from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

HOLDS, IN_PART, FAILS = "holds", "holds in part", "does not hold"
OF_SIMULATOR = "; for the simulator, whose equations imply it"
UNTESTED = "not tested: needs "


@dataclass(frozen=True)
class Part:
    """Part of a claim, with the result of a test.

    If the run cannot test the part, `holds` is None, and `measured` names what the test needs.
    `of_simulator` marks parts on simulated data, which follow from the simulator's equations.
    """

    statement: str
    holds: bool | None
    measured: str
    stand_in: str = ""
    sample: str = ""
    of_simulator: bool = False


def untested(need: str) -> Part:
    return Part("", None, need)


def verdict(parts: Sequence[Part]) -> str:
    """Return the verdict as text, which names missing requirements and stand-in codecs."""
    tested = [part.holds for part in parts if part.holds is not None]
    if not tested:
        return UNTESTED + needs_text(parts)
    if not any(tested):
        return FAILS + _stand_ins_text(parts)
    all_hold = all(tested) and len(tested) == len(parts)
    of_simulator = all(part.of_simulator for part in parts if part.holds is not None)
    label = OF_SIMULATOR if of_simulator else _stand_ins_text(parts)
    return (HOLDS if all_hold else IN_PART) + label


def _stand_ins_text(parts: Sequence[Part]) -> str:
    titles = list(dict.fromkeys(part.stand_in for part in parts if part.stand_in))
    if not titles:
        return ""
    are = "is not the thesis's codec" if len(titles) == 1 else "are not the thesis's codecs"
    return f"; tested on {' and '.join(titles)}, which {are}"


def needs_text(parts: Sequence[Part]) -> str:
    return "; ".join(dict.fromkeys(part.measured for part in parts if part.holds is None))


def results_text(parts: Sequence[Part]) -> str:
    return "; ".join(
        f"{part.statement}: {'yes' if part.holds else 'no'} ({part.measured})"
        f"{f' [{part.sample}]' if part.sample else ''}"
        for part in parts
        if part.holds is not None
    )
