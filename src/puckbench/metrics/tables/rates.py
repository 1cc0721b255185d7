from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.metrics.table_registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

_MM = 1000


@TABLES.register("rates", title="Bytes, errors and times at each rate")
def rates(metrics: pd.DataFrame) -> pd.DataFrame:
    """Size, errors and times of each codec at each rate, over all clouds of a data set.

    ``bytes``: sum of the streams. ``ratio``: bytes of the users' files per byte of the streams;
    empty if clouds do not come from files. ``rms_mm``, ``largest_mm``: RMS and largest
    point-to-point distance (D1), in mm, each the maximum of both directions. ``encode_s``,
    ``decode_s``: sums over the clouds.
    """
    import pandas as pd

    keys = ["dataset", "codec", "rate"]
    return pd.DataFrame(
        {**dict(zip(keys, names, strict=True)), **_row(rows)}
        for names, rows in metrics.groupby(keys, sort=False)
    )


def _row(rows: pd.DataFrame) -> dict[str, Any]:
    import pandas as pd

    size = rows["bytes"].sum()
    files, rms, largest = (
        rows[name] if name in rows else pd.Series(dtype=float)
        for name in ("file_bytes", "d1_rms_m", "hausdorff_point_m")
    )
    return {
        "clouds": len(rows),
        "bytes": int(size),
        "ratio": files.sum(min_count=len(rows)) / size,
        "rms_mm": _MM * float(np.sqrt((rms**2).mean())),
        "largest_mm": _MM * float(largest.max()),
        "encode_s": float(rows["encode_s"].sum()),
        "decode_s": float(rows["decode_s"].sum()),
    }
