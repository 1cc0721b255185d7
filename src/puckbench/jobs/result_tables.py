"""The tidy tables of results: one row per data set, cloud, codec and rate; one row per cloud."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from puckbench.core.errors import InputError
from puckbench.core.files import read_json

METRIC_KEYS = ("dataset", "cloud", "codec", "rate")
CLOUD_KEYS = ("dataset", "cloud")
RECOVERY_KEYS = (*METRIC_KEYS, "kind")
_FIRST = (
    *RECOVERY_KEYS,
    "group",
    "points_in",
    "points_out",
    "points",
    "bytes",
    "bpp",
    "encode_s",
    "encode_s_min",
    "encode_s_max",
    "decode_s",
    "decode_s_min",
    "decode_s_max",
    "encode_peak_mib",
    "decode_peak_mib",
    "true",
    "found",
    "matched",
    "precision",
    "recall",
    "label_accuracy",
)
"""Columns that come first, in this order, where a table has them; the others follow by name."""
SPREAD = {"q05": 0.05, "q25": 0.25, "q75": 0.75, "q95": 0.95}
"""Quantiles over clouds that stand beside each median of the summary."""
_STATISTICS = ("elongation_oriented", "duplicates", "spacing_", "density_", "outliers")
_COUNTS = {"truth_points_a", "truth_points_b", "true", "found", "matched"}
_SUMMARY = (
    "bpp",
    "cd_point",
    "cd_plane",
    "hausdorff_plane",
    "hausdorff_sq_plane",
    "d1_psnr",
    "d2_psnr",
    "truth_cd_point",
    "truth_cd_plane",
    "clean_cd_plane",
    "encode_s",
    "decode_s",
)


def table_of(rows: Iterable[dict[str, Any]], keys: Sequence[str]) -> pd.DataFrame:
    """One row per dictionary, columns in a fixed order; the order of the rows is kept.

    InputError when there is no row, or two with the same keys.
    """
    table = pd.DataFrame(list(rows))
    if table.empty:
        raise InputError("no results to put into a table")
    if table.duplicated(list(keys)).any():
        raise InputError(f"two results have the same {', '.join(keys)}")
    for name in _COUNTS & set(table):  # where some rows have none, pandas would make floats of them
        table[name] = table[name].astype("Int64")
    first = [name for name in _FIRST if name in table]
    return table[first + sorted(str(name) for name in table if name not in first)]


def metric_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
    """The result rows in the files given."""
    return [read_json(file) for file in files]


def cloud_row(dataset: str, file: Path) -> dict[str, Any]:
    """One row of the table of clouds, from the description beside a prepared cloud."""
    about = read_json(file)
    size = dict(zip(("size_x_m", "size_y_m", "size_z_m"), about["size_m"], strict=True))
    kept = {key: about[key] for key in ("group", "points", "elongation", "diameter", "scale")}
    kept |= {key: value for key, value in about.items() if key.startswith(_STATISTICS)}
    return {"dataset": dataset, "cloud": about["name"], **kept, **size}


def scan_error_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Rows of the table of scans' own errors, from result rows of scans measured as if decoded."""
    kept = (*CLOUD_KEYS, "group", "scale")
    return [
        {key: row[key] for key in row if key in kept or key.startswith(("truth_", "clean_"))}
        for row in metric_rows(files)
    ]


def recovery_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Rows of the table of recovered primitives: one per result and kind of primitive.

    A stream without primitives has a row of the kind "all" in which nothing is measured.
    """
    rows = []
    for row in metric_rows(files):
        kinds = row.pop("kinds") or [{"kind": "all"}]
        rows += [{**row, **kind} for kind in kinds]
    return rows


ROWS = {
    "scan_errors": (scan_error_rows, CLOUD_KEYS),
    "recovery": (recovery_rows, RECOVERY_KEYS),
}
"""Tables made of result rows of their own: from files to rows, and the rows' keys."""


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Medians over the clouds of each data set, codec and rate, their spread, and how many.

    ``cd_plane`` is the median, ``cd_plane_q25`` and ``cd_plane_q75`` the quartiles,
    ``cd_plane_q05`` and ``cd_plane_q95`` hold nine clouds in ten, and so on (linear between
    clouds, so that few clouds have a q05 near their least value).
    """
    groups = table.groupby(["dataset", "codec", "rate"], sort=False)
    numbers = [name for name in _SUMMARY if name in table]
    shares = [
        groups[numbers].quantile(share).add_suffix(f"_{name}") for name, share in SPREAD.items()
    ]
    medians = groups[numbers].median().assign(clouds=groups.size())
    if "weights" in table:
        medians["weights"] = groups["weights"].first()
    return pd.concat([medians, *shares], axis=1).reset_index()
