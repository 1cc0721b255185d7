"""What to store a sensor's data in: size, error and speed of every codec on clouds in metres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.metrics.coordinate_frames import in_frame
from puckbench.metrics.table_registry import SPINS_OR_RECORDINGS, TABLES

if TYPE_CHECKING:
    import pandas as pd

ERROR_MM = 5.0
"""Root mean square error (D1) at which lossy codecs are compared."""
_ROUNDING = 1.1
"""By how much an error may exceed that of rounding to a grid, which holds for points that lie
anywhere: on walls along its axes it is larger."""
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
_CLOUD, _CODEC = ["dataset", "cloud"], ["dataset", "codec"]


@TABLES.register("storage", title="What to store a sensor's data in", needs=(SPINS_OR_RECORDINGS,))
def storage(metrics: pd.DataFrame) -> pd.DataFrame:
    """Every codec on clouds in metres: at its rate of the least error, and at an error of 5 mm.

    ``kept`` is what that rate keeps: ``exact``; ``1 mm``, points rounded to a grid of 1 mm (or
    nearer); ``less`` otherwise, which stands below the others. Bits per return, megabits per second
    at the sensor's rate, root mean square errors (D1, D2) in mm and distance to the true surface
    (point to plane), errors of ranges and the largest, returns lost and made up, milliseconds for
    each turn, and speed against the sensor's (2 is twice as fast as it turns; one thread).
    ``bits_at_5_mm`` are bits per return at an error (D1) of 5 mm, interpolated between rates in the
    logarithms of both; empty where all rates are finer, or all coarser. Medians over the clouds of
    a data set.

    Parameters
    ----------
    metrics
        All results of a run; rows of scaled clouds are left out.

    Raises
    ------
    InputError
        There are no results of clouds in metres.
    """
    import pandas as pd

    known = in_frame(metrics, "metric")
    if known.empty:
        raise InputError("metrics table: no results of clouds in metres")
    known = known.assign(
        **{f"{name}_mm": 1000 * known[f"{name}_m"] for name in _IN_METRES if f"{name}_m" in known}
    )
    rows = []
    for (dataset, codec), part in known.groupby(_CODEC, sort=False):
        finest = _of_least_error(part)
        row: dict[str, Any] = {"dataset": dataset, "codec": codec, "rate": finest["rate"].iloc[0]}
        row |= {"kept": _kept(finest["d1_rms_mm"].median())}
        row |= {
            name: finest[column].median() for name, column in _MEDIANS.items() if column in finest
        }
        curves = [curve for _, curve in part.groupby("cloud")]
        at_error = [bits_at_error(curve["bpp"], curve["d1_rms_mm"], ERROR_MM) for curve in curves]
        rows.append({**row, "bits_at_5_mm": float(np.median(at_error)), "clouds": len(curves)})
    table = pd.DataFrame(rows)
    order = table["dataset"].map({name: k for k, name in enumerate(table["dataset"].unique())})
    return (
        table.assign(order=order, less=table["kept"] == "less")
        .sort_values(["order", "less", "bits_per_return"])
        .drop(columns=["order", "less"])
    )


def _of_least_error(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of one rate of a codec, the same for all clouds: of the least error, then bits."""
    medians = rows.groupby("rate", sort=False)[["d1_rms_mm", "bpp"]].median()
    finest = str(medians.sort_values(["d1_rms_mm", "bpp"]).index[0])
    return rows.loc[rows["rate"] == finest]


def _kept(error_mm: float) -> str:
    if error_mm == 0:
        return "exact"
    return "1 mm" if error_mm <= rounding_mm(1.0) else "less"


def rounding_mm(grid_mm: float) -> float:
    """Root mean square error of rounding x, y and z to a grid, half its step, at most."""
    return _ROUNDING * grid_mm / 2


def bits_at_error(bits: pd.Series[float], error_mm: pd.Series[float], at_mm: float) -> float:
    """Bits at an error, between rates in the logarithms of both; nan beyond the rates.

    Rates without error have no place on such a scale, and are left out.
    """
    error, known = error_mm.to_numpy(float), bits.to_numpy(float)
    lossy = error > 0
    error, known = error[lossy], known[lossy]
    if len(error) < 2 or not error.min() <= at_mm <= error.max():
        return float("nan")
    order = np.argsort(error)
    found = np.interp(np.log(at_mm), np.log(error[order]), np.log(known[order]))
    return float(np.exp(found))
