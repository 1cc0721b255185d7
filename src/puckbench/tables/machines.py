from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.tables.registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

_RUN_ENVIRONMENT = ("cpu", "encode_cpu", "threads", "timed_alone", "repeats", "libraries")


_COLUMNS = {"results": "Results", "codec_versions": "Codec versions"}


@TABLES.register("machines", title="Machines and versions", columns=_COLUMNS)
def machines(metrics: pd.DataFrame) -> pd.DataFrame:
    """The table lists the environments in which times were measured.

    If there is one row, all times are comparable. ``results`` is the number of result rows (one for
    each cloud, codec and rate). ``cpu`` and ``encode_cpu`` are the processors for decoding and
    encoding. ``threads`` is the number of threads of a timed call. ``timed_alone`` tells whether no
    other job ran. ``repeats`` is the number of timed calls, of which results have the median
    (``encode_s_min`` and ``encode_s_max`` are the extremes). The last columns are versions.
    """
    columns = [name for name in _RUN_ENVIRONMENT if name in metrics]
    groups = metrics.groupby(columns, sort=False, dropna=False)
    versions = metrics.groupby(columns, sort=False, dropna=False)["codec_version"]
    table = groups.size().rename("results").reset_index()
    table["codec_versions"] = [", ".join(sorted(set(names))) for _, names in versions]
    return table
