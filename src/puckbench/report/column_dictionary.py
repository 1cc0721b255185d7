from __future__ import annotations

import re
from typing import TYPE_CHECKING

from puckbench.metrics.coordinate_frames import frames_of
from puckbench.metrics.metric_registry import metric_columns
from puckbench.report.column_labels import table_heading, unit_in_frames

if TYPE_CHECKING:
    import pandas as pd

_EMPTY = (
    (r"truth_.*", "the true surface is not known"),
    (r"clean_.*", "the cloud is not a virtual scan"),
    (r"(reflectance|colour)_(?!psnr).*|bpp_\w+", "no such attribute was coded"),
    (r"[yuv]_psnr|reflectance_psnr", "lossless, or no such attribute was coded"),
    (r".*_psnr(_\w+)?", "lossless, so that the PSNR is infinite"),
    (r"(range|returns)_.*|mbit_per_s|.*_(per_turn|real_time)", "no returns of a sensor"),
    (r"(bits_|saved_|added_)?at_.*", "no two rates enclose the error"),
    (r"(saved_|added_)?grid_.*", "no rate reaches the error of the grid"),
    (r"bd_.*|shared_range", "the curves have too little in common (columns of counts)"),
    (r".*_m|.*_mm2?", "the size of the cloud in metres is not known"),
    (r"(encode|decode)_.*", "not timed"),
)
"""Patterns of column names, and why values in these columns may be missing."""
_OTHERWISE = "does not apply"


def column_dictionary(table: pd.DataFrame) -> pd.DataFrame:
    """Describe the columns of a table of results.

    Returns
    -------
    pandas.DataFrame
        A row for each column of the table: its name (``column``), ``meaning`` and ``unit``, the
        number of ``missing`` values, and the ``reason`` why values are missing.
    """
    import pandas as pd

    names, registered = [str(name) for name in table], metric_columns()
    frames = frames_of(table)
    rows = []
    for name in names:
        words, unit = table_heading(name, names)
        missing = int(table[name].isna().sum())
        rows.append(
            {
                "column": name,
                "meaning": registered.get(name, words),
                "unit": unit_in_frames(unit, frames),
                "missing": missing,
                "reason": _reason(name) if missing else "",
            }
        )
    return pd.DataFrame(rows)


def _reason(column: str) -> str:
    return next((why for name, why in _EMPTY if re.fullmatch(name, column)), _OTHERWISE)
