from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@dataclass(frozen=True)
class Count:
    """Number of items in the local copy of a data set, and the published number."""

    what: str
    held: int
    published: int

    def line(self) -> str:
        verdict = "" if self.held == self.published else ", which differs"
        return f"{self.held} of {self.published} published{verdict}"


@runtime_checkable
class Counted(Protocol):
    def counts(self) -> list[Count]:
        """Return the counts for the whole data set, without options that select scenes."""
