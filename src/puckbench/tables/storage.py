from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.metrics.coordinate_frames import rows_in_metres
from puckbench.metrics.interpolation import bits_at_error
from puckbench.results.columns import LOWER, NO_COMMON_ERROR, Column
from puckbench.tables.registry import SPINS_OR_RECORDINGS, TABLES

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
    "d1_rms_mm": "d1_rms_mm",
    "d2_rms_mm": "d2_rms_mm",
    "q99_mm": "q99_mm",
    "largest_mm": "largest_mm",
    "truth_d2_rms_mm": "truth_d2_rms_mm",
    "range_rms_mm": "range_rms_mm",
    "range_max_mm": "range_max_mm",
    "returns_lost": "returns_lost",
    "returns_added": "returns_added",
    "encode_ms_per_turn": "encode_ms_per_turn",
    "decode_ms_per_turn": "decode_ms_per_turn",
    "encode_real_time": "encode_real_time",
    "decode_real_time": "decode_real_time",
}
_IN_METRES = {
    "d1_rms_mm": "d1_rms_m",
    "d2_rms_mm": "d2_rms_m",
    "q99_mm": "q99_point_m",
    "largest_mm": "hausdorff_point_m",
    "truth_d2_rms_mm": "truth_d2_rms_m",
}
AT_ERROR = {
    "bits_at_5_mm": "d1_rms_mm",
    "bits_at_5_mm_d2": "d2_rms_mm",
    "bits_at_5_mm_range": "range_rms_mm",
}
"""Columns of bits at an equal error, and the error of each."""


def _columns() -> Iterator[Column]:
    yield Column("kept", "Kept")
    yield Column("bits_per_return", "Bits per return", "", LOWER)
    for name, error in zip(AT_ERROR, ("D1", "D2", "range"), strict=True):
        words = f"Bits per return at a {error} error of {ERROR_MM:g} mm"
        yield Column(name, words, "", LOWER, missing=NO_COMMON_ERROR)


@TABLES.register(
    "storage",
    title="What to store a sensor's data in",
    needs=(SPINS_OR_RECORDINGS,),
    columns=_columns(),
    shown=(
        *("dataset", "codec", "rate", "kept", "bits_per_return"),
        *("d1_rms_mm", "range_rms_mm", "bits_at_5_mm"),
    ),
)
def storage(metrics: pd.DataFrame) -> pd.DataFrame:
    """The table shows codecs on clouds in metres, at their most exact rate and at an error of 5 mm.

    Values are medians over clouds. ``kept`` is ``exact``; ``1 mm``, i.e. as exact as on a 1 mm
    grid; or ``less``. Codecs with ``less`` are listed last. Further columns of the most exact rate
    are: bits per return, megabits per second at the sensor's speed, RMS errors in mm (D1, D2, D2 to
    the true surface, ranges), the 99 % quantile and the largest of the point-to-point distances in
    mm, numbers of returns lost and added, milliseconds per turn, and coding speed relative to the
    sensor on one thread (2: twice as fast).

    ``bits_at_5_mm``, ``..._d2`` and ``..._range`` are bits per return at an RMS error of 5 mm, by
    D1, by D2 and of the ranges. They are interpolated linearly on log-log axes, and empty if no
    rates enclose this error. Equal D1 favours codecs whose errors lie along the rays: at the same
    D1, an octree has 1/√3 of their range error.
    """
    import pandas as pd

    rows = rows_in_metres(metrics)
    present = {name: column for name, column in _IN_METRES.items() if column in rows}
    rows = rows.assign(**{name: 1000 * rows[column] for name, column in present.items()})
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
    return {
        "rate": finest["rate"].iloc[0],
        "kept": _kept(finest["d1_rms_mm"].median()),
        **{name: finest[column].median() for name, column in _MEDIANS.items() if column in finest},
        **{
            name: float(
                np.median([bits_at_error(curve["bpp"], curve[error], ERROR_MM) for curve in curves])
            )
            for name, error in AT_ERROR.items()
            if error in rows
        },
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
    """Return the RMS error in mm that rounding to a grid may have, including a tolerance."""
    return _ROUNDING * grid_mm / 2
