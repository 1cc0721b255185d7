from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError
from puckbench.metrics.coordinate_frames import rows_in_frame
from puckbench.metrics.interpolation import bits_at_error
from puckbench.metrics.statistics import SCENE, Estimate, means_over_seeds, with_scenes
from puckbench.results.columns import Column, column_named
from puckbench.tables.against_octree import bits_on_grid
from puckbench.tables.registry import SEVERAL_NOISES, TABLES
from puckbench.tables.storage import ERROR_MM

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.tables.against_octree",)

_GRID_MM = 1.0
BITS = ("grid_1_mm", "at_5_mm")
"""Columns of bits per return: lossless or on a 1 mm grid, and at equal error."""
_COMPARED = ("added_grid_1_mm", "saved_grid_1_mm_percent", "added_at_5_mm", "saved_at_5_mm_percent")
"""Columns that compare with the error model of the least noise."""
_RAYS = (SCENE, "sensor", "turns", "firings")
"""Columns that are equal for clouds of the same rays."""
_CLOUD = ["dataset", "cloud"]


def _columns() -> Iterator[Column]:
    yield Column("models", "Error models")
    for name in BITS:
        bits = column_named(name)
        words = f"{bits.words}: added by the noise"
        yield replace(bits, name=f"added_{name}", words=words)
        words = f"{bits.words}: saved with the least noise"
        yield replace(bits, name=f"saved_{name}_percent", words=words, unit="%", better=None)


@TABLES.register(
    "noise_bits",
    title="What the sensor's noise costs",
    needs=(SEVERAL_NOISES,),
    columns=_columns(),
    shown=(
        *("dataset", "error_model", "codec", "noise_bits", "grid_1_mm"),
        *("at_5_mm", "added_at_5_mm", "scenes"),
    ),
)
def noise_bits(metrics: pd.DataFrame, clouds: pd.DataFrame) -> pd.DataFrame:
    """The table shows the bits per return that the same rays need under several error models.

    Values are means over scenes (of means over seeds). From six scenes on, ``low`` and ``high`` are
    95 % intervals by Student's t. A cell is empty if no rate of the codec reaches the column's
    error. ``noise_bits`` is the entropy of the model's noise at the sensor's range resolution,
    given incidence and range, after subtraction of each laser's mean error in each turn.
    ``grid_1_mm`` is the fewest bits of a rate with at most the D1 error of rounding to a 1 mm grid.
    ``at_5_mm`` is the number of bits at a D1 RMS error of 5 mm, interpolated linearly on log-log
    axes.

    ``added_...`` is the difference to the error model with the least noise. ``saved_..._percent``
    tells how much fewer bits this quietest model needs. ``models`` is the number of error models of
    the rays. ``scenes`` is the number of scenes with a value, of the column with the fewest.
    """
    import pandas as pd

    scans = _scans_of_several_models(rows_in_frame(clouds, "metric"))
    curves = rows_in_frame(metrics, "metric").groupby([*_CLOUD, "codec"])
    bits = pd.DataFrame(
        {**dict(zip((*_CLOUD, "codec"), names, strict=True)), **_bits(curve)}
        for names, curve in curves
    )
    rows = bits.merge(scans, on=_CLOUD)
    if rows.empty:
        raise InputError("metrics table: no results of the same rays under several error models")
    named = ["models", "dataset", "error_model", "codec", "rays"]
    rows = means_over_seeds(rows, named, ["noise_bits", *BITS])
    quietest = rows[rows["noise_bits"] == rows.groupby("rays")["noise_bits"].transform("min")]
    quietest = quietest.drop_duplicates(["rays", "codec"])[["rays", "codec", *BITS]]
    rows = rows.merge(quietest, on=["rays", "codec"], how="left", suffixes=("", "_least"))
    for column in BITS:
        rows[f"added_{column}"] = rows[column] - rows[f"{column}_least"]
        rows[f"saved_{column}_percent"] = 100 * (1 - rows[f"{column}_least"] / rows[column])
    keys = ["models", "dataset", "error_model", "codec"]
    values = ["noise_bits", *BITS, *_COMPARED]
    rows = rows.groupby([*keys, SCENE])[values].mean().reset_index()
    table = pd.DataFrame(
        {**dict(zip(keys, names, strict=True)), **_estimates(part)}
        for names, part in rows.groupby(keys)
    )
    order = ["models", "noise_bits", "dataset", "grid_1_mm", "at_5_mm"]
    return table.sort_values(order, ascending=[False, True, True, True, True])


def _estimates(rows: pd.DataFrame) -> dict[str, float]:
    values: dict[str, float] = {"noise_bits": float(rows["noise_bits"].mean())}
    for column in (*BITS, *_COMPARED):
        estimate = Estimate.of(rows[column])
        values |= {column: estimate.mean}
        values |= {f"{column}_low": estimate.low, f"{column}_high": estimate.high}
    counts = rows[list(BITS)].count()
    return {**values, "scenes": int(min(counts[counts > 0], default=0))}


def _bits(curve: pd.DataFrame) -> dict[str, Any]:
    error_mm = 1000 * curve["d1_rms_m"]
    exact = bits_on_grid(curve["bpp"], error_mm, _GRID_MM)
    at_error = bits_at_error(curve["bpp"], error_mm, ERROR_MM)
    return dict(zip(BITS, (exact, at_error), strict=True))


def _scans_of_several_models(clouds: pd.DataFrame) -> pd.DataFrame:
    if not {*_CLOUD, "sensor", "error_model", "noise_bits"} <= set(clouds):
        raise InputError("clouds table: no cloud has an entropy of noise (column noise_bits)")
    noisy = with_scenes(clouds.dropna(subset=["noise_bits"]))
    rays = noisy.groupby([name for name in _RAYS if name in noisy])
    noisy = noisy.assign(rays=rays.ngroup(), models=rays["error_model"].transform("nunique"))
    columns = [*_CLOUD, SCENE, "error_model", "noise_bits", "rays", "models"]
    return noisy.loc[noisy["models"] > 1, columns]
