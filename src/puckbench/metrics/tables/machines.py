from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.metrics.table_registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

_RUN_ENVIRONMENT = ("cpu", "encode_cpu", "threads", "timed_alone", "repeats", "libraries")


@TABLES.register("machines", title="Machines and versions")
def machines(metrics: pd.DataFrame) -> pd.DataFrame:
    """Environments in which times were measured. If there is one row, all times are comparable.

    ``results``: number of result rows (cloud, codec, rate). ``cpu``, ``encode_cpu``: processors for
    decoding and encoding. ``threads``: threads of a timed call. ``timed_alone``: whether no other
    job ran. ``repeats``: number of timed calls; results have the median (``encode_s_min``,
    ``encode_s_max``: extremes). The last columns are versions.
    """
    columns = [name for name in _RUN_ENVIRONMENT if name in metrics]
    groups = metrics.groupby(columns, sort=False, dropna=False)
    versions = metrics.groupby(columns, sort=False, dropna=False)["codec_version"]
    table = groups.size().rename("results").reset_index()
    table["codec_versions"] = [", ".join(sorted(set(names))) for _, names in versions]
    return table
