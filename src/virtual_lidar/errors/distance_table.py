from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from virtual_lidar.errors.model import (
    ERROR_MODELS,
    Distribution,
    Draws,
    ErrorModel,
    Hits,
    standard_noise,
)


@ERROR_MODELS.register("distance_table")
class DistanceTable(ErrorModel):
    """Error model whose noise depends on the true distance d by a table of yours.

    A measured range is ``d + N(mu(d), sigma(d))``. The mean mu and the scale sigma are interpolated
    linearly between the rows of the table, and constant beyond its ends.
    """

    table: tuple[tuple[float, ...], ...]
    """Rows of distance, mu and sigma, m, by increasing distance."""
    distribution: Distribution = "gaussian"
    """``gaussian``, or ``laplace`` with b = sigma."""

    @model_validator(mode="after")
    def _of_rising_distances(self) -> Self:
        if not self.table:
            raise InputError("table is empty")
        if any(len(row) != 3 for row in self.table):
            raise InputError("table has a row that is not distance, mu, sigma")
        distance, _, sigma = np.transpose(self.table)
        if (np.diff(distance) <= 0).any():
            raise InputError("table has distances that do not increase")
        if (sigma < 0).any():
            raise InputError("table has a sigma below 0")
        return self

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        distance, mean, scale = np.transpose(self.table)
        noisy = standard_noise(draws.running("ray"), hits.distance.shape, self.distribution)
        noisy *= np.interp(hits.distance, distance, scale)
        noisy += np.interp(hits.distance, distance, mean)
        noisy += hits.distance
        return noisy
