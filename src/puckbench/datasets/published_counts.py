"""Counts of what is there of a data set beside the counts that its authors published."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@dataclass(frozen=True)
class Count:
    """One count: what is counted, the number there is, and the number published."""

    what: str
    held: int
    published: int

    def line(self) -> str:
        """The count in words; what differs says so."""
        verdict = "" if self.held == self.published else ", which differs"
        return f"{self.held} of {self.published} published{verdict}"


@runtime_checkable
class Counted(Protocol):
    """A scene set whose counts can be checked."""

    def counts(self) -> list[Count]:
        """Counts of the whole data set, whatever the options choose of it."""
