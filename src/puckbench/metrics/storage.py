"""What to store a sensor's data in: size, error and speed of every codec on clouds in metres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.metrics.frames import in_frame
from puckbench.metrics.registry import SPINS_OR_RECORDINGS, TABLES

if TYPE_CHECKING:
    import pandas as pd

ERROR_MM = 5.0
"""Root mean square error (D1) at which lossy codecs are compared."""
_MEDIANS = {
    "bits_per_return": "bpp",
    "mbit_per_s": "mbit_per_s",
    "rms_mm": "d1_rms_mm",
    "range_rms_mm": "range_rms_mm",
    "range_max_mm": "range_max_mm",
    "returns_lost": "returns_lost",
    "encode_real_time": "encode_real_time",
    "decode_real_time": "decode_real_time",
}


@TABLES.register("storage", title="What to store a sensor's data in", needs=(SPINS_OR_RECORDINGS,))
def storage(metrics: pd.DataFrame) -> pd.DataFrame:
    """Every codec on clouds in metres: at its finest rate, and at an error of 5 mm.

    Medians over the clouds of a data set. Bits per return, megabits per second at the sensor's
    rate, root mean square error (D1) in mm, that of ranges and their largest, returns lost, speed
    of encoding and decoding against the sensor's (2 is twice as fast as it turns; one thread), and
    ``bits_at_5_mm``, bits per return at an error of 5 mm, interpolated between rates in the
    logarithms of both; empty where all rates are finer, or all coarser.

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
    known = known.assign(d1_rms_mm=1000 * known["d1_rms_m"])
    rows = []
    for (dataset, codec), part in known.groupby(["dataset", "codec"], sort=False):
        curves = [rows.sort_values("bpp") for _, rows in part.groupby("cloud", sort=False)]
        finest = pd.DataFrame([curve.iloc[-1] for curve in curves])
        row: dict[str, Any] = {"dataset": dataset, "codec": codec, "rate": finest["rate"].iloc[0]}
        row |= {
            name: finest[column].median() for name, column in _MEDIANS.items() if column in finest
        }
        at_error = [bits_at_error(curve["bpp"], curve["d1_rms_mm"], ERROR_MM) for curve in curves]
        rows.append({**row, "bits_at_5_mm": float(np.median(at_error)), "clouds": len(curves)})
    table = pd.DataFrame(rows)
    order = table["dataset"].map({name: k for k, name in enumerate(table["dataset"].unique())})
    return table.assign(order=order).sort_values(["order", "bits_per_return"]).drop(columns="order")


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
