from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import SOURCES
from puckbench.published_sources.rows import rows_beside

if TYPE_CHECKING:
    import pandas as pd


@SOURCES.register(
    "reno",
    title="RENO",
    address="github.com/NJUVISION/RENO, commit 8691929, results; arXiv:2503.12382, abstract",
    licence="MIT",
    remark="G-PCC and RENO per frame of the validation split of KITTI detection.",
)
def reno() -> pd.DataFrame:
    """RENO (CVPR 2025) beside G-PCC on KITTI."""
    return rows_beside(__file__, "94ed1cf80fc92695295dc85f5e261d278cbd21e6710b7d8ebb016067ab7e70d4")
