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
        What this part says, such as "Draco improves".
    holds
        Whether the run confirms it, or None if the run cannot decide.
    measured
        The measurement; where `holds` is None, what the run would need.
    stand_in
        Title of the codec that was tested in place of the thesis's, or empty.
    sample
        Number of clouds, rates or residuals behind the measurement.
    of_simulator
        Whether the data are simulated and the result follows from the simulator's equations.
    """

    statement: str
    holds: bool | None
    measured: str
    stand_in: str = ""
    sample: str = ""
    of_simulator: bool = False


def untested(need: str) -> Part:
    """Return a part that the run cannot decide, because it lacks what `need` names."""
    return Part("", None, need)


def verdict(parts: Sequence[Part]) -> str:
    """Return the verdict on a claim by the results of its parts.

    Returns
    -------
    str
        "holds" if all parts were tested and hold, "holds in part" if some do, "does not hold" if
        none does, or "not tested: needs ..." with what the run lacks. A remark follows if all
        data are simulated, or codecs stand in for the thesis's.
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
    """Return what the run would need to test the other parts, separated by semicolons."""
    return "; ".join(dict.fromkeys(part.measured for part in parts if part.holds is None))


def results_text(parts: Sequence[Part]) -> str:
    """Return each tested part as "statement: yes (measured) [sample]", separated by semicolons."""
    return "; ".join(
        f"{part.statement}: {'yes' if part.holds else 'no'} ({part.measured})"
        f"{f' [{part.sample}]' if part.sample else ''}"
        for part in parts
        if part.holds is not None
    )
