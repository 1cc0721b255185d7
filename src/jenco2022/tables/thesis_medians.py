from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from jenco2022.claims.evidence import Evidence
from jenco2022.claims.roles import GPCC, GPCC_AS_RUN, SAMPLED
from jenco2022.published_rates import ROOMS, median_rows
from puckbench.metrics.table_registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = ("cd_plane", "hausdorff_sq_plane")


@TABLES.register(
    "thesis_medians",
    title="The thesis's medians beside this run's",
    category="Claims",
    needs=("thesis_medians",),
)
def thesis_medians(
    metrics: pd.DataFrame, *, datasets: Mapping[str, str], codecs: Mapping[str, str]
) -> pd.DataFrame:
    """Medians over clouds by rate, read off thesis figure 6.5, beside the medians of this run.

    Distances are point-to-plane, in squared grid units. The thesis's values are accurate to about
    5 %; the thesis's G-PCC truncates coordinates.

    Parameters
    ----------
    datasets, codecs
        As in `Evidence`.
    """
    import pandas as pd

    medians = Evidence(metrics, datasets=datasets, codecs=codecs).medians
    kinds = medians["dataset"].map(dict(datasets)).replace(SAMPLED, ROOMS)
    roles = medians["codec"].replace(GPCC, GPCC_AS_RUN)
    here = medians.assign(kind=kinds, role=roles, name=medians["codec"].map(dict(codecs)))
    thesis = pd.DataFrame(list(median_rows())).drop(columns=["cloud", "bpp"])
    thesis = thesis.rename(columns={"dataset": "kind", "codec": "role"})
    both = here.merge(thesis, on=["kind", "role", "rate"], suffixes=("", "_thesis"))
    return pd.concat([_rows(both, quantity) for quantity in QUANTITIES], ignore_index=True)


def _rows(both: pd.DataFrame, quantity: str) -> pd.DataFrame:
    numbers = {"thesis": both[f"{quantity}_thesis"], "here": both[quantity]}
    names = both[["dataset", "kind", "name", "rate"]].rename(columns={"name": "codec"})
    return names.assign(quantity=quantity, **numbers)
