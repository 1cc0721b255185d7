from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import SOURCES
from puckbench.published_sources.rows import rows_beside

if TYPE_CHECKING:
    import pandas as pd


@SOURCES.register(
    "geocnnv2",
    title="GeoCNNv2",
    address="github.com/mauriceqch/pcc_geo_cnn_v2, results/data.csv",
    licence="MIT",
)
def geocnnv2() -> pd.DataFrame:
    """GeoCNNv2 (2020), its variants c1 to c6, and G-PCC's octree and trisoup."""
    return rows_beside(__file__, "6cb8baabc79d8d83f2647f63540fcc9dcc0ea24ebbb78561a19c00c1d392b159")
