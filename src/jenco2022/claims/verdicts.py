from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

HOLDS, IN_PART, FAILS = "holds", "holds in part", "does not hold"
OF_SIMULATOR = "; for the simulator, whose equations imply it"
UNTESTED = "not tested: needs "


@dataclass(frozen=True)
class Part:
    """A part of a claim, with the result of its test.

    Parameters
    ----------
    statement
        What this part of the claim says, such as "Draco improves".
    holds
        Whether the run confirms the statement, or None if the run cannot decide.
    measured
        What was measured, as text. If `holds` is None, it is what the run would need.
    stand_in
        Title of the codec that was tested in place of the thesis's codec, or empty.
    sample
        Number of clouds, rates or residuals behind the measurement, as text.
    of_simulator
        Whether the data are simulated, so that the result follows from the simulator's equations.
    """

    statement: str
    holds: bool | None
    measured: str
    stand_in: str = ""
    sample: str = ""
    of_simulator: bool = False


def untested(need: str) -> Part:
    """Return the result for a part that a run cannot decide, because it lacks what `need` names."""
    return Part("", None, need)


def verdict(parts: Sequence[Part]) -> str:
    """Return the verdict on a claim, given the results of its parts.

    Returns
    -------
    str
        "holds" if all parts were tested and hold, "holds in part" if only some do, "does not hold"
        if no tested part does, or "not tested: needs ..." with what the run lacks. A remark follows
        if all data are simulated, or if other codecs were tested than the thesis's.
    """
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
    """Return what the run would need to test the untested parts, separated by semicolons."""
    return "; ".join(dict.fromkeys(part.measured for part in parts if part.holds is None))


def results_text(parts: Sequence[Part]) -> str:
    """Return the results of all tested parts as text.

    A result is "statement: yes (measured) [sample]", or "no"; semicolons separate results.
    """
    return "; ".join(
        f"{part.statement}: {'yes' if part.holds else 'no'} ({part.measured})"
        f"{f' [{part.sample}]' if part.sample else ''}"
        for part in parts
        if part.holds is not None
    )
