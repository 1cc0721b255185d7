"""The thesis's medians of Figure 6.5 beside those of a run, rate by rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from puckbench.metrics.table_registry import TABLES
from puckbench.thesis.claims.evidence import Evidence
from puckbench.thesis.claims.roles import GPCC, GPCC_AS_RUN, SAMPLED
from puckbench.thesis.published_rates import ROOMS, median_rows

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
    """Medians over clouds per rate as read off the thesis's Figure 6.5, and those of this run.

    The thesis's are read to about 5 %; this run's are of the data sets and codecs that are like the
    thesis's. Squared grid units, point-to-plane. The thesis's G-PCC truncated coordinates; where a
    run also has one that rounds them, it stands beside the same numbers.

    Parameters
    ----------
    metrics
        All results of a run.
    datasets, codecs
        As of `puckbench.thesis.tables.claims.claims`.

    Returns
    -------
    pd.DataFrame
        One row per data set, codec, rate and quantity that both have: ``dataset``, ``kind`` (what
        the data set is), ``codec`` (the run's name for it), ``rate``, ``quantity`` (`QUANTITIES`),
        ``thesis`` and ``here``.
    """
    import pandas as pd

    found = Evidence(metrics, datasets=datasets, codecs=codecs).medians
    kinds = found["dataset"].map(dict(datasets)).replace(SAMPLED, ROOMS)
    like = found["codec"].replace(GPCC, GPCC_AS_RUN)
    ours = found.assign(kind=kinds, like=like, name=found["codec"].map(dict(codecs)))
    theirs = pd.DataFrame(list(median_rows())).drop(columns=["cloud", "bpp"])
    theirs = theirs.rename(columns={"dataset": "kind", "codec": "like"})
    both = ours.merge(theirs, on=["kind", "like", "rate"], suffixes=("", "_thesis"))
    tables = [_of(both, quantity) for quantity in QUANTITIES]
    return pd.concat(tables, ignore_index=True)


def _of(both: pd.DataFrame, quantity: str) -> pd.DataFrame:
    numbers = {"thesis": both[f"{quantity}_thesis"], "here": both[quantity]}
    names = both[["dataset", "kind", "name", "rate"]].rename(columns={"name": "codec"})
    return names.assign(quantity=quantity, **numbers)
