"""On what the times of a run were taken: processors, threads, repetitions, libraries."""

from __future__ import annotations

import pandas as pd

_CIRCUMSTANCES = ("cpu", "encode_cpu", "threads", "timed_alone", "repeats", "libraries")


def machines(metrics: pd.DataFrame) -> pd.DataFrame:
    """One row for each run environment in which results were timed, with their number.

    More than one row says that times were taken on different processors, or with other numbers of
    threads or versions, and are not all to be compared.
    """
    columns = [name for name in _CIRCUMSTANCES if name in metrics]
    groups = metrics.groupby(columns, sort=False, dropna=False)
    versions = metrics.groupby(columns, sort=False, dropna=False)["codec_version"]
    found = groups.size().rename("results").reset_index()
    found["codec_versions"] = [", ".join(sorted(set(names))) for _, names in versions]
    return found
