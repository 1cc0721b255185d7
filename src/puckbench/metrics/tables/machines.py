from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.metrics.table_registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

_RUN_ENVIRONMENT = ("cpu", "encode_cpu", "threads", "timed_alone", "repeats", "libraries")


@TABLES.register("machines", title="Machines and versions")
def machines(metrics: pd.DataFrame) -> pd.DataFrame:
    """Environments in which times were measured; if there is one row, all times are comparable.

    ``results``: number of result rows (cloud, codec, rate) that were measured in the environment.
    ``cpu``, ``encode_cpu``: processors for decoding and encoding. ``threads`` of a timed call.
    ``timed_alone``: whether no other job ran. ``repeats``: number of timed calls; results have
    their median (``encode_s_min`` and ``encode_s_max`` are the extremes). Versions follow.
    """
    columns = [name for name in _RUN_ENVIRONMENT if name in metrics]
    groups = metrics.groupby(columns, sort=False, dropna=False)
    versions = metrics.groupby(columns, sort=False, dropna=False)["codec_version"]
    table = groups.size().rename("results").reset_index()
    table["codec_versions"] = [", ".join(sorted(set(names))) for _, names in versions]
    return table
