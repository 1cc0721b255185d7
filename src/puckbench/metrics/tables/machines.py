from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.metrics.table_registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

_RUN_ENVIRONMENT = ("cpu", "encode_cpu", "threads", "timed_alone", "repeats", "libraries")


@TABLES.register("machines", title="Machines and versions")
def machines(metrics: pd.DataFrame) -> pd.DataFrame:
    """Run environments in which times were measured, with numbers of results; with one row, all
    times can be compared.

    Columns: processors for decoding and encoding, threads of a timed call, whether the job ran
    alone, repetitions (times are medians; ``encode_s_min`` and ``encode_s_max`` are extremes),
    versions of libraries and codecs.
    """
    columns = [name for name in _RUN_ENVIRONMENT if name in metrics]
    groups = metrics.groupby(columns, sort=False, dropna=False)
    versions = metrics.groupby(columns, sort=False, dropna=False)["codec_version"]
    table = groups.size().rename("results").reset_index()
    table["codec_versions"] = [", ".join(sorted(set(names))) for _, names in versions]
    return table
