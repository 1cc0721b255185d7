"""Tables that join the rows of results which many jobs wrote."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError
from pointkit.files import read_object
from puckbench.results.columns import FRAME, declared_among

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.results.columns",)

METRIC_KEYS = ("dataset", "cloud", "codec", "rate")
"""Columns whose values together identify a row of results; the other keys are those of the clouds,
of recovered primitives and of drives."""
CLOUD_KEYS = ("dataset", "cloud")
RECOVERY_KEYS = (*METRIC_KEYS, "kind")
DRIVE_KEYS = (*METRIC_KEYS, "times")
_STATISTICS = ("elongation_oriented", "duplicates", "spacing_", "density_", "outliers")
_OF_CLOUDS = ("group", "points", "elongation", "diameter", "scale")
_OF_SPINS = ("sensor", "turns", "seconds", "firings", "noise_bits", "error_model")
_LEFT_OUT = ("dropped_points", "missing_returns")


def table_of(rows: Iterable[dict[str, Any]], keys: Sequence[str]) -> pd.DataFrame:
    """Return rows of results as a table with ordered columns.

    Parameters
    ----------
    rows
        Rows of results: values by name of the column.
    keys
        Names of the columns whose values together identify a row.

    Raises
    ------
    InputError
        There are no rows, or two rows have the same values of `keys`.
    """
    import pandas as pd

    table = pd.DataFrame(list(rows))
    if table.empty:
        raise InputError("no results to put into a table")
    if table.duplicated(list(keys)).any():
        raise InputError(f"two results have the same {', '.join(keys)}")
    declared = declared_among(table)
    for each in declared:
        if each.counts:  # pandas makes floats of integers if values are missing
            table[each.name] = table[each.name].astype("Int64")
    first = [each.name for each in declared if each.leads]
    return table[first + sorted(str(name) for name in table if name not in first)]


def cloud_row(dataset: str, file: Path) -> dict[str, Any]:
    """Return the row of a cloud in the table ``clouds``, from the cloud's description (JSON)."""
    about = read_object(file)
    if missing := sorted({*_OF_CLOUDS, "name", "size_m"} - about.keys()):
        raise InputError(f"{file}: not the description of a prepared cloud, without {missing[0]}")
    size = dict(zip(("size_x_m", "size_y_m", "size_z_m"), about["size_m"], strict=True))
    kept = {key: about[key] for key in _OF_CLOUDS}
    kept |= {key: value for key, value in about.items() if key.startswith(_STATISTICS)}
    kept |= {key: about[key] for key in ("scene", "digest", *_LEFT_OUT) if key in about}
    if "format" in about:
        kept["source"] = about["source"]
    if about.get("size") == 0:
        kept |= {FRAME: "metric"} | {key: about[key] for key in _OF_SPINS if key in about}
    return {"dataset": dataset, "cloud": about["name"], **kept, **size}


def scan_error_row(file: Path) -> dict[str, Any]:
    """Return the row of a scan in the table ``scan_errors``, from its results (JSON)."""
    kept = (*CLOUD_KEYS, "scene", "group", "scale", FRAME)
    row = read_object(file)
    return {key: row[key] for key in row if key in kept or key.startswith(("truth_", "clean_"))}
