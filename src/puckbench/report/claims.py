"""Claims as cards: the claim, the verdict of a run, and what was measured."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from puckbench.report.tables import text_of

if TYPE_CHECKING:
    import pandas as pd

TABLE = "claims"
_CLASSES = {"holds": "good", "holds in part": "partly", "does not hold": "bad"}
_BETWEEN_PARTS = re.compile(r"; (?![^(]*\))")


@dataclass(frozen=True)
class ClaimCard:
    """One claim.

    Parameters
    ----------
    heading
        Its number and section.
    verdict, remark, kind
        The verdict, what it depends on, and the class that colours it.
    text
        The claim.
    measured
        What was measured, part by part.
    beside
        What else is known, by name.
    figures
        Name and title of our figures that show it.
    """

    heading: str
    verdict: str
    remark: str
    kind: str
    text: str
    measured: tuple[str, ...]
    beside: Mapping[str, str]
    figures: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Claims:
    """All claims, with how many have which verdict."""

    cards: tuple[ClaimCard, ...]
    link: str

    @property
    def counts(self) -> Mapping[str, int]:
        """Verdicts by how often they were given, in the order of the first."""
        return Counter(card.verdict for card in self.cards)


def claim_cards(table: pd.DataFrame, figures: Mapping[str, str], link: str) -> Claims:
    """The cards of the table ``claims``; figures: titles of those in the page, by name."""
    rows = [{str(k): text_of(v) for k, v in row.items()} for row in table.to_dict("records")]
    return Claims(tuple(_card(row, figures) for row in rows), link)


def _card(row: Mapping[str, str], figures: Mapping[str, str]) -> ClaimCard:
    verdict, remark = _parted(row["verdict"])
    names = [name for name in row.get("figure", "").split(", ") if name in figures]
    beside = {
        "Published": row.get("thesis", ""),
        "By the published numbers": row.get("thesis_verdict", ""),
    }
    beside["Could not be tested without"] = (
        "" if verdict == "not tested" else row.get("not_tested", "")
    )
    return ClaimCard(
        heading=f"{row['number']} · Section {row['section']}",
        verdict=verdict,
        remark=remark,
        kind=_CLASSES.get(verdict, "open"),
        text=row["claim"],
        measured=_parts(row.get("here", "")),
        beside={name: text for name, text in beside.items() if text},
        figures=tuple((name, figures[name]) for name in names),
    )


def _parted(verdict: str) -> tuple[str, str]:
    """The verdict's own words, and what follows after a colon or semicolon."""
    found: Sequence[Any] = re.split(r"[:;] ", verdict, maxsplit=1)
    return found[0], found[1] if len(found) > 1 else ""


def _parts(text: str) -> tuple[str, ...]:
    return tuple(part for part in _BETWEEN_PARTS.split(text) if part)
