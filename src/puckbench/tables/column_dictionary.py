from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.metrics.coordinate_frames import frames_of
from puckbench.results.columns import column_named, unit_in_frames

if TYPE_CHECKING:
    import pandas as pd


def column_dictionary(table: pd.DataFrame) -> pd.DataFrame:
    """Describe the columns of a table of results.

    Returns
    -------
    pandas.DataFrame
        A row for each column of the table: its name (``column``), ``meaning`` and ``unit``, the
        number of ``missing`` values, and the ``reason`` why values are missing.
    """
    import pandas as pd

    names, frames = [str(name) for name in table], frames_of(table)
    rows = []
    for name in names:
        described, missing = column_named(name, names), int(table[name].isna().sum())
        rows.append(
            {
                "column": name,
                "meaning": described.words,
                "unit": unit_in_frames(described.unit, frames),
                "missing": missing,
                "reason": described.reason if missing else "",
            }
        )
    return pd.DataFrame(rows)
