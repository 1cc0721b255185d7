from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.results.columns import HIGHER, Column
from puckbench.tables.registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

_SQUARED = {"d1_rms_mm": "d1_rms_m", "d2_rms_mm": "d2_rms_m", "truth_d2_rms_mm": "truth_d2_rms_m"}
_LARGEST = {"q99_mm": "q99_point_m", "largest_mm": "hausdorff_point_m"}


_OF_FILES = (
    Column(
        "file_ratio", "Bytes of files per byte of streams", better=HIGHER, printed="file / stream"
    ),
    Column("coded", "In the streams", missing="the clouds come from no files"),
)


@TABLES.register(
    "rates",
    title="Bits, errors and times at each rate",
    columns=_OF_FILES,
    shown=("dataset", "codec", "rate", "bpp", "d1_rms_mm", "d2_rms_mm", "encode_s", "decode_s"),
)
def rates(metrics: pd.DataFrame) -> pd.DataFrame:
    """The table shows bits per point, errors and coding times for each data set, codec and rate.

    ``bpp`` is the mean over the clouds. ``d1_rms_mm`` and ``d2_rms_mm`` are RMS distances, point to
    point and point to plane, the larger of both directions. ``q99_mm`` and ``largest_mm`` are the
    99 % quantile and the largest of the point-to-point distances, for the worst of the clouds.
    ``range_rms_mm`` is the RMS error of the ranges, for clouds of a sensor's returns.
    ``truth_d2_rms_mm`` is the RMS distance to the true surface, point to plane. RMS values are over
    clouds, too. ``encode_s`` and ``decode_s`` are seconds for a million points. ``file_ratio`` is
    the number of bytes of the users' files per byte of the streams, ``coded`` lists what streams
    contain, and ``not_coded`` what only the files contain. Files store coordinates as numbers or
    text; the errors tell how exactly streams store them. Columns that do not apply to any cloud are
    left out.
    """
    import pandas as pd

    keys = ["dataset", "codec", "rate"]
    table = pd.DataFrame(
        {**dict(zip(keys, names, strict=True)), **_row(rows)}
        for names, rows in metrics.groupby(keys, sort=False)
    )
    return table.dropna(axis="columns", how="all")


def _row(rows: pd.DataFrame) -> dict[str, Any]:
    points, size = rows["points_in"].sum(), rows["bytes"].sum()
    values: dict[str, Any] = {"clouds": len(rows), "bpp": float(rows["bpp"].mean())}
    values |= {k: 1000 * _rms(rows[v]) for k, v in _SQUARED.items() if v in rows}
    values |= {k: 1000 * float(rows[v].max()) for k, v in _LARGEST.items() if v in rows}
    if "range_rms_mm" in rows:
        values["range_rms_mm"] = _rms(rows["range_rms_mm"])
    for name in ("encode_s", "decode_s"):
        if name in rows:
            values[name] = 1e6 * float(rows[name].sum(min_count=len(rows))) / float(points)
    if "file_bytes" in rows:
        values["file_ratio"] = rows["file_bytes"].sum(min_count=len(rows)) / size
        values |= _contents(rows)
    return values


def _contents(rows: pd.DataFrame) -> dict[str, str | None]:
    """Return what is in the streams, and what is only in the files from which clouds were made."""
    if rows["file_bytes"].isna().any():
        return {"coded": None, "not_coded": None}
    left = _names(rows, "not_coded")
    coded = [name for name in _names(rows, "file_attributes") if name not in left]
    if dropped := int(rows["dropped_points"].sum()) if "dropped_points" in rows else 0:
        left.append(f"{dropped:,} points")
    return {"coded": ", ".join(["positions", *coded]), "not_coded": ", ".join(left) or None}


def _names(rows: pd.DataFrame, column: str) -> list[str]:
    texts = rows[column].dropna() if column in rows else ()
    return list(dict.fromkeys(name for text in texts for name in text.split(", ")))


def _rms(values: pd.Series[float]) -> float:
    return float(np.sqrt((values**2).mean()))
