from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.metrics.coordinate_frames import rows_in_metres
from puckbench.metrics.table_registry import SPINS_OR_RECORDINGS, TABLES

if TYPE_CHECKING:
    import pandas as pd

ERROR_MM = 5.0
"""D1 RMS error at which lossy codecs are compared."""
_ROUNDING = 1.1
"""Largest tolerated ratio of an error to that of uniform points rounded to a grid. Walls parallel
to the grid have larger errors."""
_MEDIANS = {
    "bits_per_return": "bpp",
    "mbit_per_s": "mbit_per_s",
    "rms_mm": "d1_rms_mm",
    "d2_rms_mm": "d2_rms_mm",
    "truth_rms_mm": "truth_d2_rms_mm",
    "range_rms_mm": "range_rms_mm",
    "range_max_mm": "range_max_mm",
    "returns_lost": "returns_lost",
    "returns_added": "returns_added",
    "encode_ms_per_turn": "encode_ms_per_turn",
    "decode_ms_per_turn": "decode_ms_per_turn",
    "encode_real_time": "encode_real_time",
    "decode_real_time": "decode_real_time",
}
_IN_METRES = ("d1_rms", "d2_rms", "truth_d2_rms")


@TABLES.register("storage", title="What to store a sensor's data in", needs=(SPINS_OR_RECORDINGS,))
def storage(metrics: pd.DataFrame) -> pd.DataFrame:
    """Every codec on clouds in metres, at the rate of least error and at an error of 5 mm; medians
    over clouds.

    ``kept``: ``exact``; ``1 mm``, as exact as on a 1 mm grid; or ``less``, listed last. Further
    columns: bits per return, megabits per second at the sensor's speed, RMS errors (D1, D2, point
    to plane to the true surface, ranges) in mm, numbers of returns lost and added, milliseconds per
    turn, and coding speed relative to the sensor on one thread (2: twice as fast).
    ``bits_at_5_mm``: bits per return at a D1 RMS error of 5 mm, interpolated linearly on log-log
    axes; empty if no rates enclose this error.
    """
    import pandas as pd

    rows = rows_in_metres(metrics)
    present = [name for name in _IN_METRES if f"{name}_m" in rows]
    rows = rows.assign(**{f"{name}_mm": 1000 * rows[f"{name}_m"] for name in present})
    table = pd.DataFrame(
        {"dataset": dataset, "codec": codec, **_row(part)}
        for (dataset, codec), part in rows.groupby(["dataset", "codec"], sort=False)
    )
    order = pd.factorize(table["dataset"])[0]
    return (
        table.assign(order=order, less=table["kept"] == "less")
        .sort_values(["order", "less", "bits_per_return"])
        .drop(columns=["order", "less"])
    )


def _row(rows: pd.DataFrame) -> dict[str, Any]:
    finest = _of_least_error(rows)
    curves = [curve for _, curve in rows.groupby("cloud")]
    at_error = [bits_at_error(curve["bpp"], curve["d1_rms_mm"], ERROR_MM) for curve in curves]
    return {
        "rate": finest["rate"].iloc[0],
        "kept": _kept(finest["d1_rms_mm"].median()),
        **{name: finest[column].median() for name, column in _MEDIANS.items() if column in finest},
        "bits_at_5_mm": float(np.median(at_error)),
        "clouds": len(curves),
    }


def _of_least_error(rows: pd.DataFrame) -> pd.DataFrame:
    medians = rows.groupby("rate", sort=False)[["d1_rms_mm", "bpp"]].median()
    finest = str(medians.sort_values(["d1_rms_mm", "bpp"]).index[0])
    return rows.loc[rows["rate"] == finest]


def _kept(error_mm: float) -> str:
    if error_mm == 0:
        return "exact"
    return "1 mm" if error_mm <= rounding_mm(1.0) else "less"


def rounding_mm(grid_mm: float) -> float:
    """Return the RMS error, in mm, of rounding points to a grid, plus a tolerance."""
    return _ROUNDING * grid_mm / 2


def bits_at_error(bits: pd.Series[float], error_mm: pd.Series[float], at_mm: float) -> float:
    """Return the bits at the error `at_mm`; nan outside the range of lossy rates.

    Interpolation is linear in log bits and log error.
    """
    error, rate = error_mm.to_numpy(float), bits.to_numpy(float)
    lossy = error > 0
    error, rate = error[lossy], rate[lossy]
    if len(error) < 2 or not error.min() <= at_mm <= error.max():
        return float("nan")
    order = np.argsort(error)
    log_bits = np.interp(np.log(at_mm), np.log(error[order]), np.log(rate[order]))
    return float(np.exp(log_bits))
