"""On what the times of a run were taken: processors, threads, repetitions, libraries."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.metrics.table_registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

_RUN_ENVIRONMENT = ("cpu", "encode_cpu", "threads", "timed_alone", "repeats", "libraries")


@TABLES.register("machines", title="Machines and versions")
def machines(metrics: pd.DataFrame) -> pd.DataFrame:
    """On what the times were taken: one row for each run environment, and how many results it has.

    Processor of decoding and of encoding, threads that a timed call might use, whether the job ran
    alone, repetitions (their median counts; ``encode_s_min`` and ``encode_s_max`` are the extremes)
    and versions of libraries and codecs. One row: all times can be compared.
    """
    columns = [name for name in _RUN_ENVIRONMENT if name in metrics]
    groups = metrics.groupby(columns, sort=False, dropna=False)
    versions = metrics.groupby(columns, sort=False, dropna=False)["codec_version"]
    found = groups.size().rename("results").reset_index()
    found["codec_versions"] = [", ".join(sorted(set(names))) for _, names in versions]
    return found
