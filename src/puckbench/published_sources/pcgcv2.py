from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import SOURCES
from puckbench.published_sources.rows import rows_beside

if TYPE_CHECKING:
    import pandas as pd


@SOURCES.register(
    "pcgcv2",
    title="PCGCv2",
    address="github.com/NJUVISION/PCGCv2, commit 88ff2a1, results",
    licence="MIT",
)
def pcgcv2() -> pd.DataFrame:
    """PCGCv2 (DCC 2021) on seven clouds."""
    return rows_beside(__file__, "2d7df8a819fd1fedbbd4e33d2e2f22490058158175ed41f9475deb0c43d971e2")
