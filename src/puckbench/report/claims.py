from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from puckbench.report.cells import cell_text

if TYPE_CHECKING:
    import pandas as pd

TABLE = "claims"
_CLASSES = {"holds": "good", "holds in part": "partly", "does not hold": "bad"}
_UNTESTED = "not tested"
_SEPARATOR = re.compile(r"; (?![^(]*\))")
"""A semicolon outside parentheses."""


@dataclass(frozen=True)
class ClaimCard:
    """A claim with its verdict and measurements.

    `kind` is the CSS class for the verdict's colour; `context` maps headings to further texts.
    """

    heading: str
    verdict: str
    remark: str
    kind: str
    text: str
    measured: tuple[str, ...]
    context: Mapping[str, str]
    figures: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Claims:
    cards: tuple[ClaimCard, ...]
    link: str

    def __bool__(self) -> bool:
        return any(card.verdict != _UNTESTED for card in self.cards)

    @property
    def counts(self) -> Mapping[str, int]:
        return Counter(card.verdict for card in self.cards)


def claim_cards(table: pd.DataFrame, figures: Mapping[str, str], link: str) -> Claims:
    rows = [{str(k): cell_text(v) for k, v in row.items()} for row in table.to_dict("records")]
    return Claims(tuple(_card(row, figures) for row in rows), link)


def _card(row: Mapping[str, str], figures: Mapping[str, str]) -> ClaimCard:
    verdict, remark = _split_verdict(row["verdict"])
    names = [name for name in row.get("figure", "").split(", ") if name in figures]
    context = {
        "Published": row.get("thesis", ""),
        "By the published numbers": row.get("thesis_verdict", ""),
    }
    context["Could not be tested without"] = (
        "" if verdict == _UNTESTED else row.get("not_tested", "")
    )
    return ClaimCard(
        heading=f"{row['number']} · Section {row['section']}",
        verdict=verdict,
        remark=remark,
        kind=_CLASSES.get(verdict, "open"),
        text=row["claim"],
        measured=measured_parts(row.get("here", "")),
        context={name: text for name, text in context.items() if text},
        figures=tuple((name, figures[name]) for name in names),
    )


def _split_verdict(verdict: str) -> tuple[str, str]:
    words: Sequence[Any] = re.split(r"[:;] ", verdict, maxsplit=1)
    return words[0], words[1] if len(words) > 1 else ""


def measured_parts(text: str) -> tuple[str, ...]:
    return tuple(part for part in _SEPARATOR.split(text) if part)
