from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import SOURCES
from puckbench.published_sources.rows import rows_beside

if TYPE_CHECKING:
    import pandas as pd


@SOURCES.register(
    "unicorn",
    title="Unicorn",
    address="github.com/NJUVISION/Unicorn, commit f69d322, Unicorn-v1 and Unicorn-v3",
    licence="no licence file",
    remark="G-PCC's configuration is not given; times are of machines that are not stated.",
)
def unicorn() -> pd.DataFrame:
    """Unicorn v1 and v3 (TPAMI 2024, TCSVT 2025), beside G-PCC v21, V-PCC and GeS v3."""
    return rows_beside(__file__, "85d8b65bd874436e77e1be9d3dfad908bd2fb548436a6ad230f840372faa58c8")
