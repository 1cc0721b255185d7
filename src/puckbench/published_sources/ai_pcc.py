from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import SOURCES
from puckbench.published_sources.rows import rows_beside

if TYPE_CHECKING:
    import pandas as pd


@SOURCES.register(
    "ai_pcc",
    title="AI-PCC proposal",
    address="github.com/NJUVISION/Unicorn, commit f69d322, Unicorn-v2/proposal/result/PCGC",
    licence="no licence file",
    remark="The sheet has no anchor. Bits are divided by the points before coding.",
)
def ai_pcc() -> pd.DataFrame:
    """Unicorn v2 as proposed to MPEG's call for AI-based point-cloud coding (2024)."""
    return rows_beside(__file__, "405fe60b4cc29b4c0dbe2a762303cdecd8372ad6dd0d53919b0abd3b484fe89a")
