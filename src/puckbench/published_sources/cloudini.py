from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import SOURCES
from puckbench.published_sources.rows import rows_beside

if TYPE_CHECKING:
    import pandas as pd


@SOURCES.register(
    "cloudini",
    title="Cloudini",
    address="github.com/facontidavide/cloudini, README.md",
    licence="Apache-2.0",
    remark="The two clouds are called random examples; neither is published.",
)
def cloudini() -> pd.DataFrame:
    """Cloudini's sizes and times beside those of LZ4 and Zstandard."""
    return rows_beside(__file__, "04a1f01c9b921aa7237c5da073869bdace09e86d94ac628fe5159b6dfd8ba138")
