from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import CUBIC, SOURCES
from puckbench.published_sources.rows import rows_beside

if TYPE_CHECKING:
    import pandas as pd


@SOURCES.register(
    "sparsepcgc",
    title="SparsePCGC",
    address="github.com/NJUVISION/SparsePCGC, commit 696de11, results",
    licence="MIT",
    interpolation=CUBIC,
    remark="G-PCC for LiDAR is the octree without the angular mode (test/kitti.cfg).",
)
def sparsepcgc() -> pd.DataFrame:
    """SparsePCGC (2022) beside G-PCC, PCGCv2, GeoCNNv2 and ADL-PCC, with printed BD-rates."""
    return rows_beside(__file__, "88b0e0722b58584112efeb9f0a3b88937ec830ab51f96cabcde9f89efe6293f4")
