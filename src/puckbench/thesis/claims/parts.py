"""What a claim says, part by part, and the verdict that follows from its parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

HOLDS, IN_PART, FAILS = "holds", "holds in part", "does not hold"
UNTESTED = "not tested: needs "


@dataclass(frozen=True)
class Part:
    """One statement of a claim, what was measured about it, and whether it holds.

    holds: None where the run cannot tell; `found` then names what that needs.
    """

    statement: str
    holds: bool | None
    found: str


def needs(what: str, statement: str = "") -> Part:
    """A part that the run cannot test, and what it would need."""
    return Part(statement, None, what)


def verdict(parts: Sequence[Part]) -> str:
    """`HOLDS` when every part was tested and holds, `FAILS` when no tested one does.

    `IN_PART` when some hold and others do not, or could not be tested; ``not tested: needs ...``
    when none could.
    """
    tested = [part.holds for part in parts if part.holds is not None]
    if not tested:
        return UNTESTED + wanted(parts)
    if not any(tested):
        return FAILS
    return HOLDS if all(tested) and len(tested) == len(parts) else IN_PART


def wanted(parts: Sequence[Part]) -> str:
    """What the parts that could not be tested need, each thing once."""
    return "; ".join(dict.fromkeys(part.found for part in parts if part.holds is None))


def told(parts: Sequence[Part]) -> str:
    """The parts that were tested, with what was found and whether they hold."""
    return "; ".join(
        f"{part.statement}: {'yes' if part.holds else 'no'} ({part.found})"
        for part in parts
        if part.holds is not None
    )
