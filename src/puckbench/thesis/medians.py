"""The thesis's medians of Figure 6.5 beside those of a run, rate by rate."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from puckbench.thesis.claims.evidence import Evidence
from puckbench.thesis.claims.roles import GPCC, GPCC_AS_RUN, SAMPLED
from puckbench.thesis.published_rates import ROOMS, median_rows

QUANTITIES = ("cd_plane", "hausdorff_sq_plane")


def thesis_medians(
    metrics: pd.DataFrame, *, datasets: Mapping[str, str], codecs: Mapping[str, str]
) -> pd.DataFrame:
    """One row per data set, codec, rate and quantity that the thesis and the run both have.

    datasets and codecs: as of `puckbench.thesis.claims.table.claims`. Columns: ``dataset``,
    ``kind`` (what the data set is), ``codec`` (the run's name for it), ``rate``, ``quantity``
    (`QUANTITIES`, squared grid units), ``thesis`` (read off to about 5 %) and ``here``. The
    thesis's G-PCC is that with truncated coordinates; where a run has both, the other stands
    beside the same numbers.
    """
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
