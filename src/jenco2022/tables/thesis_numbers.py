from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from jenco2022 import published
from jenco2022.tables.residual_statistics import ALL, residual_statistics
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.results.columns import Column
from puckbench.tables.registry import SENSOR, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

NEAR, FAR = "std, walls and floors, 1 to 5 m", "std, walls and floors, 30 m"
DISTANCE = "earth mover's distance to the real residuals, 1 to 5 m"


_COLUMNS = (
    Column("thesis_m", "Thesis", "m", missing="the thesis has no such number"),
    Column("here_m", "Here", "m", missing="not estimated"),
)


@TABLES.register(
    "thesis_numbers",
    title="The thesis's numbers beside this run's",
    category=SENSOR,
    needs=("thesis",),
    columns=_COLUMNS,
)
def thesis_numbers(residuals: pd.DataFrame) -> pd.DataFrame:
    """Numbers of thesis figures 5.18 and 5.19 beside those of this run, in metres.

    ``here_half_m`` is the half width of a 95 % interval. In the thesis, earth mover's distances are
    from the real residuals. In this run, they are from a normal distribution with the real
    residuals' mean and standard deviation. The thesis's standard deviations of ``vlp16`` and
    ``vlp16_divergence`` do not follow from the thesis's parameters (docs/notes/chapter5.md).
    """
    import pandas as pd

    statistics = residual_statistics(residuals)
    near = residuals[residuals["distance_m"] < published.FAR_M]
    models = list(dict.fromkeys(near["model"].astype(str)))
    rows = [_spread(NEAR, model, published.MODEL_STDS_M, statistics, ALL) for model in models]
    rows += [_distance(model, near) for model in models]
    far = f"{published.FAR_M:g}"
    far_models = set(residuals.loc[residuals["distance_m"] >= published.FAR_M, "model"])
    rows += [
        _spread(FAR, model, published.FAR_STDS_M, statistics, far)
        for model in models
        if model in far_models
    ]
    return pd.DataFrame(rows)


def distance_to_normal(sample: Floats, mean: float, std: float) -> float:
    """Return the earth mover's distance of a sample from a normal distribution.

    Parameters
    ----------
    sample
        Values, (n,).
    mean, std
        Mean and standard deviation of the normal distribution, in the unit of the sample.

    Raises
    ------
    InputError
        The sample is empty.
    """
    from scipy.special import ndtri

    if len(sample) == 0:
        raise InputError("the distance to a normal distribution needs a nonempty sample")
    levels = (np.arange(len(sample)) + 0.5) / len(sample)
    return float(np.abs(np.sort(sample) - (mean + std * ndtri(levels))).mean())


def _spread(
    quantity: str, model: str, thesis: Mapping[str, float], statistics: pd.DataFrame, distance: str
) -> dict[str, Any]:
    keys = {"model": model, "surface": ALL, "distance_m": distance, "laser_id": ALL}
    matches = np.all([statistics[key] == value for key, value in keys.items()], axis=0)
    row = statistics[matches].iloc[0]
    return _row(quantity, model, _printed(thesis, model), row["std_m"], row["std_half_m"])


def _distance(model: str, near: pd.DataFrame) -> dict[str, Any]:
    sample = near.loc[near["model"] == model, "residual_m"].to_numpy(dtype=np.float64)
    here = distance_to_normal(sample, published.REAL_MEAN_M, published.REAL_STD_M)
    return _row(DISTANCE, model, _printed(published.MODEL_DISTANCES_M, model), here, None)


def _printed(numbers: Mapping[str, float], model: str) -> float | None:
    return numbers.get(published.FITTED_TO_5_18.get(model, model))


def _row(
    quantity: str, model: str, thesis: float | None, here: float, half: float | None
) -> dict[str, Any]:
    numbers = {"thesis_m": thesis, "here_m": here, "here_half_m": half}
    return {"quantity": quantity, "model": model, **numbers}
