"""Bits of every codec against those of G-PCC's octree, at equal errors and on equal grids."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.metrics.coordinate_frames import in_frame
from puckbench.metrics.table_registry import OCTREE_AND_OTHERS, SPINS_OR_RECORDINGS, TABLES
from puckbench.metrics.tables.storage import bits_at_error, rounding_mm

if TYPE_CHECKING:
    import pandas as pd

OCTREE = "gpcc"
"""G-PCC's octree without the sensor: what papers on LiDAR compare with, with better options."""
COMPLETE_OCTREE = "gpcc_lossless"
"""The same, where every point is kept: its bits are the octree's without loss, in runs with it."""
ERRORS_MM = (20.0, 10.0, 5.0)
"""Root mean square errors (D1) at which codecs are compared."""
GRIDS_MM = (2.0, 1.0)
"""Grids that are coded without loss."""


@TABLES.register(
    "against_octree",
    title="Bits against those of G-PCC's octree",
    needs=(SPINS_OR_RECORDINGS, OCTREE_AND_OTHERS),
)
def against_octree(metrics: pd.DataFrame) -> pd.DataFrame:
    """Bits per return at equal errors and on equal grids, and what each codec saves (%) against
    ``gpcc``, G-PCC's octree without the sensor. Papers compare with that octree under options that
    take up to 6 % more bits (``gpcc_no_sensor``).

    ``at_5_mm`` is at a root mean square error (D1) of 5 mm, interpolated between rates in the
    logarithms of both. ``grid_1_mm`` is without loss on a grid of 1 mm: the fewest bits of a rate
    whose error is that of rounding to the grid, or less, and that gives back as many points as
    there were; against ``gpcc_lossless``, which keeps them all, in runs that have it. A codec that
    gives back exactly what the sensor measured is below every grid. Cells are empty where no rate
    reaches; ``coarsest_mm`` and ``finest_mm`` are the errors that rates reach. Medians over the
    clouds that have the value.

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
    known = known.assign(error_mm=1000 * known["d1_rms_m"])
    pairs = known[["dataset", "codec"]].drop_duplicates().itertuples(index=False)
    table = pd.DataFrame(
        _row(dataset, codec, known[(known["dataset"] == dataset) & (known["codec"] == codec)])
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


def _columns() -> list[str]:
    return [f"at_{mm:g}_mm" for mm in ERRORS_MM] + [f"grid_{mm:g}_mm" for mm in GRIDS_MM]


def _row(dataset: str, codec: str, rows: pd.DataFrame) -> dict[str, Any]:
    clouds = [curve for _, curve in rows.groupby("cloud", sort=False)]
    values = np.array([_bits(curve) for curve in clouds])
    found = {
        name: float(np.median(column[np.isfinite(column)])) if np.isfinite(column).any() else np.nan
        for name, column in zip(_columns(), values.T, strict=True)
    }
    reached = [(curve["error_mm"].max(), curve["error_mm"].min()) for curve in clouds]
    coarsest, finest = np.median(np.array(reached), axis=0)
    return {
        "dataset": dataset, "codec": codec, **found,
        "coarsest_mm": float(coarsest), "finest_mm": float(finest), "clouds": len(clouds),
    }  # fmt: skip


def _bits(curve: pd.DataFrame) -> list[float]:
    """Bits of one cloud at each error, then on each grid; nan where no rate reaches."""
    at_errors = [bits_at_error(curve["bpp"], curve["error_mm"], mm) for mm in ERRORS_MM]
    return at_errors + [bits_without_loss(curve, mm) for mm in GRIDS_MM]


def bits_without_loss(curve: pd.DataFrame, grid_mm: float) -> float:
    """The fewest bits on a grid with every point; nan where no rate has all and so little error.

    Parameters
    ----------
    curve
        Result rows (``bpp``, ``error_mm``, ``points_in``, ``points_out``) of a codec and a cloud.
    grid_mm
        The grid's step.
    """
    complete = curve[curve["points_out"] == curve["points_in"]]
    return bits_on_grid(complete["bpp"], complete["error_mm"], grid_mm)


def bits_on_grid(bits: pd.Series[float], error_mm: pd.Series[float], grid_mm: float) -> float:
    """The fewest bits with no more than a grid's error; nan where no rate has so little."""
    enough = bits[error_mm <= rounding_mm(grid_mm)]
    return float(enough.min()) if len(enough) else float("nan")
