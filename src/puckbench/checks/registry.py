"""The registry of checks, and how a check ends.

A check is a function of a `puckbench.checks.subject.Subject`. It returns a line on what it found in
order, or raises one of the exceptions below::

    @CHECKS.register("version", rank=100, advice="set version")
    def version(subject: Subject) -> str: ...
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple

from pointkit.registry import Registry

if TYPE_CHECKING:
    from puckbench.checks.subject import Subject

Outcome = Literal["passed", "failed", "advice", "left out"]


class Fault(Exception):  # noqa: N818 (it ends a check)
    """Raised by a check if the codec is wrong; the message says what is wrong and what to do."""


class Advice(Exception):  # noqa: N818 (it ends a check)
    """Raised by a check if the codec works but should be changed; the message says how."""


class LeftOut(Exception):  # noqa: N818 (it ends a check)
    """Raised by a check that does not apply to the codec; the message says why."""


class Check(NamedTuple):
    """A check of codecs.

    Parameters
    ----------
    name
        Name of the check.
    call
        Function that takes the codec under check. It returns a line on what is in order, or raises
        `Fault`, `Advice` or `LeftOut`.
    rank
        Position among the checks; all others need the first.
    advice
        What to do if the codec raises an exception, ends its process, or does not end.
    seconds
        Time limit, s.
    """

    name: str
    call: Callable[[Subject], str]
    rank: int
    advice: str
    seconds: float = 30.0

    @property
    def title(self) -> str:
        """The name in words."""
        return self.name.replace("_", " ")


CHECKS: Registry[Check] = Registry("check", "checks", make=Check)


def checks() -> list[Check]:
    """Return all checks in the order in which they run."""
    return sorted(map(CHECKS.get, CHECKS.names()), key=lambda check: check.rank)


class Finding(NamedTuple):
    """What a check found.

    Parameters
    ----------
    check
        Title of the check.
    clouds
        The clouds that the codec was called with: ``scaled``, ``metric`` or ``returns``.
    outcome
        How the check ended.
    line
        What is in order, or what is wrong and what to do.
    seconds
        Time that the check took, s.
    """

    check: str
    clouds: str
    outcome: Outcome
    line: str
    seconds: float = 0.0
