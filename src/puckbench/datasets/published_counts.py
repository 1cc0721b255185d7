"""Compare the counts of a data set on disk with published counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@dataclass(frozen=True)
class Count:
    """A count: what is counted, the number on disk, and the published number."""

    what: str
    held: int
    published: int

    def line(self) -> str:
        """Return the count in words, with a remark if it differs."""
        verdict = "" if self.held == self.published else ", which differs"
        return f"{self.held} of {self.published} published{verdict}"


@runtime_checkable
class Counted(Protocol):
    """A data set with published counts."""

    def counts(self) -> list[Count]:
        """Return counts of the whole data set, whatever its options select."""
