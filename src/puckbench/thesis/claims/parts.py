"""The parts of a claim, and the verdict that follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

HOLDS, IN_PART, FAILS = "holds", "holds in part", "does not hold"
UNTESTED = "not tested: needs "


@dataclass(frozen=True)
class Part:
    """One statement of a claim, what was measured, and whether it holds.

    Parameters
    ----------
    statement
        In the present tense.
    holds
        None where the run cannot decide it; `found` then names what that needs.
    found
        What was measured.
    stand_in
        Title of the codec that it was measured on where that is not the thesis's own.
    sample
        How much it was measured on, "7 clouds, 8 rates".
    """

    statement: str
    holds: bool | None
    found: str
    stand_in: str = ""
    sample: str = ""


def needs(what: str, statement: str = "") -> Part:
    """A part that the run cannot test.

    Parameters
    ----------
    what
        What it would need.
    statement
        Of the claim.
    """
    return Part(statement, None, what)


def verdict(parts: Sequence[Part]) -> str:
    """The verdict on a claim.

    Returns
    -------
    str
        `HOLDS` when every part was tested and holds, `FAILS` when no tested one does, `IN_PART`
        when some hold and others do not, or could not be tested; ``not tested: needs ...`` when
        none could. A verdict that rests on other codecs than the thesis's says so.
    """
    tested = [part.holds for part in parts if part.holds is not None]
    if not tested:
        return UNTESTED + wanted(parts)
    if not any(tested):
        return FAILS + _not_the_thesis_s(parts)
    whole = all(tested) and len(tested) == len(parts)
    return (HOLDS if whole else IN_PART) + _not_the_thesis_s(parts)


def _not_the_thesis_s(parts: Sequence[Part]) -> str:
    titles = list(dict.fromkeys(part.stand_in for part in parts if part.stand_in))
    if not titles:
        return ""
    are = "is not the thesis's codec" if len(titles) == 1 else "are not the thesis's codecs"
    return f"; tested on {' and '.join(titles)}, which {are}"


def wanted(parts: Sequence[Part]) -> str:
    """What the parts that could not be tested need, each need once."""
    return "; ".join(dict.fromkeys(part.found for part in parts if part.holds is None))


def told(parts: Sequence[Part]) -> str:
    """The tested parts as text: whether each holds, what was measured, and on how much."""
    return "; ".join(
        f"{part.statement}: {'yes' if part.holds else 'no'} ({part.found})"
        f"{f' [{part.sample}]' if part.sample else ''}"
        for part in parts
        if part.holds is not None
    )
