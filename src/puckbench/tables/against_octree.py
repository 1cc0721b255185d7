from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.metrics.coordinate_frames import rows_in_metres
from puckbench.metrics.interpolation import bits_at_error
from puckbench.results.columns import HIGHER, Column, column_named
from puckbench.tables.registry import OCTREE_AND_OTHERS, SPINS_OR_RECORDINGS, TABLES
from puckbench.tables.storage import rounding_mm

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.tables.storage",)

OCTREE = "gpcc"
"""Name of G-PCC's octree coder, which papers on LiDAR compression take as anchor. It does not
know the sensor."""
COMPLETE_OCTREE = "gpcc_lossless"
"""Name of the octree coder that keeps duplicate points, which is the anchor for lossless coding."""
ERRORS_MM = (20.0, 10.0, 5.0)
"""Root mean squares of D1 distances, in mm, at which the bits of codecs are compared."""
GRIDS_MM = (2.0, 1.0)
"""Steps, in mm, of the grids on which lossless coding is compared."""


def _columns() -> list[str]:
    return [f"at_{mm:g}_mm" for mm in ERRORS_MM] + [f"grid_{mm:g}_mm" for mm in GRIDS_MM]


def _own_columns() -> Iterator[Column]:
    yield Column("coarsest_mm", "Largest D1 error of the rates", "mm")
    yield Column("finest_mm", "Smallest D1 error of the rates", "mm")
    for name in _columns():
        saved = column_named(name)
        yield replace(
            saved, name=f"saved_{name}", words=f"{saved.words}: saved", unit="%", better=HIGHER
        )


@TABLES.register(
    "against_octree",
    title="Bits against those of G-PCC's octree",
    needs=(SPINS_OR_RECORDINGS, OCTREE_AND_OTHERS),
    columns=_own_columns(),
    shown=(
        *("dataset", "codec", "at_10_mm", "saved_at_10_mm"),
        *("at_5_mm", "saved_at_5_mm", "grid_1_mm", "saved_grid_1_mm"),
    ),
)
def against_octree(metrics: pd.DataFrame) -> pd.DataFrame:
    """The table compares the bits per return of each codec with those of ``gpcc``.

    ``gpcc`` is G-PCC's octree coder without knowledge of the sensor. Papers use this anchor with
    options that take up to 6 % more bits (``gpcc_no_sensor``). Bits are compared at equal errors
    and on equal grids. They are medians over clouds, and ``saved_...`` is the percentage saved.

    ``at_5_mm`` is the number of bits at a D1 RMS error of 5 mm, interpolated linearly on log-log
    axes. ``grid_1_mm`` is the fewest bits of a rate that keeps the number of points, with at most
    the error of rounding to a 1 mm grid. Its anchor is ``gpcc_lossless``, which keeps duplicate
    points, if the run has it. A cell is empty if no rate reaches the error. ``coarsest_mm`` and
    ``finest_mm`` are the largest and the smallest error of all rates.
    """
    import pandas as pd

    rows = rows_in_metres(metrics)
    rows = rows.assign(error_mm=1000 * rows["d1_rms_m"])
    pairs = rows[["dataset", "codec"]].drop_duplicates().itertuples(index=False)
    table = pd.DataFrame(
        _row(dataset, codec, rows[(rows["dataset"] == dataset) & (rows["codec"] == codec)])
        for dataset, codec in pairs
    )
    octree = table[table["codec"] == OCTREE].set_index("dataset")
    complete = table[table["codec"] == COMPLETE_OCTREE].set_index("dataset")
    for column in _columns():
        anchor = table["dataset"].map(octree[column])
        if column.startswith("grid"):
            anchor = table["dataset"].map(complete[column]).fillna(anchor)
        table[f"saved_{column}"] = 100 * (1 - table[column] / anchor)
    order = pd.factorize(table["dataset"])[0]
    return table.assign(order=order).sort_values(["order", "grid_1_mm"]).drop(columns="order")


def _row(dataset: str, codec: str, rows: pd.DataFrame) -> dict[str, Any]:
    clouds = [curve for _, curve in rows.groupby("cloud", sort=False)]
    values = np.array([_bits(curve) for curve in clouds])
    medians = {
        name: float(np.median(column[np.isfinite(column)])) if np.isfinite(column).any() else np.nan
        for name, column in zip(_columns(), values.T, strict=True)
    }
    error_ranges = [(curve["error_mm"].max(), curve["error_mm"].min()) for curve in clouds]
    coarsest, finest = np.median(np.array(error_ranges), axis=0)
    return {
        "dataset": dataset, "codec": codec, **medians,
        "coarsest_mm": float(coarsest), "finest_mm": float(finest), "clouds": len(clouds),
    }  # fmt: skip


def _bits(curve: pd.DataFrame) -> list[float]:
    at_errors = [bits_at_error(curve["bpp"], curve["error_mm"], mm) for mm in ERRORS_MM]
    return at_errors + [bits_without_loss(curve, mm) for mm in GRIDS_MM]


def bits_without_loss(curve: pd.DataFrame, grid_mm: float) -> float:
    """Return the fewest bits that keep all points, with at most a grid's rounding error.

    Parameters
    ----------
    curve
        Results of a codec on one cloud, a row for each rate.
    grid_mm
        Step of the grid in mm.

    Returns
    -------
    float
        Bits per point, or nan if no rate is good enough.
    """
    complete = curve[curve["points_out"] == curve["points_in"]]
    return bits_on_grid(complete["bpp"], complete["error_mm"], grid_mm)


def bits_on_grid(bits: pd.Series[float], error_mm: pd.Series[float], grid_mm: float) -> float:
    """Return the fewest bits with which the error is at most that of rounding to a grid.

    Parameters
    ----------
    bits, error_mm
        Bits per point and D1 RMS errors in mm of a codec's rates.
    grid_mm
        Step of the grid in mm.

    Returns
    -------
    float
        Bits per point, or nan if no rate is good enough.
    """
    enough = bits[error_mm <= rounding_mm(grid_mm)]
    return float(enough.min()) if len(enough) else float("nan")
