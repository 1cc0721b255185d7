"""What the sensor's noise costs in bits: the same rays under several error models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from puckbench.core.errors import InputError
from puckbench.metrics.coordinate_frames import in_frame
from puckbench.metrics.table_registry import SEVERAL_NOISES, TABLES
from puckbench.metrics.tables.against_octree import bits_on_grid
from puckbench.metrics.tables.storage import ERROR_MM, bits_at_error

if TYPE_CHECKING:
    import pandas as pd

_GRID_MM = 1.0
BITS = ("grid_1_mm", "at_5_mm")
"""Columns of bits per return: exact or on a grid of 1 mm, and at an equal error."""
_RAYS = ("cloud", "sensor", "turns", "firings")
"""Columns of the table of clouds in which clouds of the same rays are alike."""
_CLOUD = ["dataset", "cloud"]


@TABLES.register("noise_bits", title="What the sensor's noise costs", needs=(SEVERAL_NOISES,))
def noise_bits(metrics: pd.DataFrame, clouds: pd.DataFrame) -> pd.DataFrame:
    """Bits per return of the same rays in the same scenes under several error models.

    ``noise_bits`` is the entropy of the noise that the model added, in steps of the sensor's
    ranges, without the mean error of each laser in each turn. ``grid_1_mm`` is exact, or without
    loss on a grid of 1 mm: the fewest bits of a rate whose error (D1) is that of rounding to the
    grid, or less. ``at_5_mm`` is at a root mean square error (D1) of 5 mm, interpolated between
    rates in the logarithms of both. ``added_...`` is how much more that is than under the model
    with the least noise. Medians over the clouds; empty where no rate reaches. ``models`` is how
    many error models the rays were scanned under.

    Parameters
    ----------
    metrics, clouds
        All results and clouds of a run; scaled clouds, those without ``noise_bits`` (recordings)
        and those whose rays were scanned under one error model alone are left out.

    Raises
    ------
    InputError
        No rays were scanned under several error models.
    """
    import pandas as pd

    alike = _of_several_models(in_frame(clouds, "metric"))
    curves = in_frame(metrics, "metric").groupby([*_CLOUD, "codec"])
    found = pd.DataFrame(
        {**dict(zip((*_CLOUD, "codec"), names, strict=True)), **_bits(curve)}
        for names, curve in curves
    )
    known = found.merge(alike, on=_CLOUD)
    if known.empty:
        raise InputError("metrics table: no results of the same rays under several error models")
    least = known[known["noise_bits"] == known.groupby("rays")["noise_bits"].transform("min")]
    least = least.drop_duplicates(["rays", "codec"])[["rays", "codec", *BITS]]
    known = known.merge(least, on=["rays", "codec"], how="left", suffixes=("", "_least"))
    for column in BITS:
        known[f"added_{column}"] = known[column] - known[f"{column}_least"]
    columns = ["noise_bits", *BITS, *(f"added_{column}" for column in BITS)]
    keys = ["models", "dataset", "error_model", "codec"]
    table = known.groupby(keys)[columns].median()
    table["clouds"] = known.groupby(keys).size()
    order = ["models", "noise_bits", "dataset", "grid_1_mm", "at_5_mm"]
    return table.reset_index().sort_values(order, ascending=[False, True, True, True, True])


def _bits(curve: pd.DataFrame) -> dict[str, Any]:
    """Bits of one cloud by one codec, as `BITS` names them."""
    error_mm = 1000 * curve["d1_rms_m"]
    exact = bits_on_grid(curve["bpp"], error_mm, _GRID_MM)
    at_error = bits_at_error(curve["bpp"], error_mm, ERROR_MM)
    return dict(zip(BITS, (exact, at_error), strict=True))


def _of_several_models(clouds: pd.DataFrame) -> pd.DataFrame:
    """Clouds whose rays were scanned under several error models, with a number for the rays."""
    if not {*_CLOUD, "sensor", "error_model", "noise_bits"} <= set(clouds):
        raise InputError("clouds table: no cloud has the entropy of its noise (noise_bits)")
    known = clouds.dropna(subset=["noise_bits"])
    rays = known.groupby([name for name in _RAYS if name in known])
    known = known.assign(rays=rays.ngroup(), models=rays["error_model"].transform("nunique"))
    return known.loc[known["models"] > 1, [*_CLOUD, "error_model", "noise_bits", "rays", "models"]]
