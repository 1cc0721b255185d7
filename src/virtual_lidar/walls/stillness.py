from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.return_table import ReturnTable

SHIFT_M = 0.003
"""Greatest `turn_shift` of a sensor at rest, m."""

# Neighbours on a surface, between which distances are interpolated: the step of a VLP-16 is 0.1 to
# 0.4 degrees; at a greater change of distance there is an edge.
_WIDEST_GAP_RAD, _GREATEST_STEP_M = math.radians(0.9), 0.1
_SECTORS, _LEAST_IN_SECTOR, _LEAST_SECTORS = 36, 30, 3
# Lasers are placed side by side on one axis, more than a turn apart.
_LASER_STRIDE = 7.0


@dataclass(frozen=True)
class Still:
    """A series of revolutions in which the sensor was at rest.

    Parameters
    ----------
    first, last
        Numbers of the first and the last revolution.
    shift_m
        Greatest `turn_shift` between the first revolution and any other of the series, m.
    """

    first: int
    last: int
    shift_m: float

    @property
    def turns(self) -> int:
        """Number of revolutions."""
        return self.last - self.first + 1


def still_rows(table: ReturnTable, limit_m: float = SHIFT_M) -> tuple[ReturnTable, Still]:
    """Find the longest part of a recording in which the sensor was at rest.

    Parameters
    ----------
    table
        The recording.
    limit_m
        Greatest `turn_shift` between revolutions of a sensor at rest, m.

    Returns
    -------
    tuple of ReturnTable and Still
        The returns of this part, and its revolutions.

    Raises
    ------
    InputError
        The recording has only one revolution, or the sensor was never at rest.
    """
    turns = _turns(table)
    if len(turns) < 2:
        raise InputError("a recording of one turn does not show whether the sensor stood still")
    numbers = list(turns)
    best = run = Still(numbers[0], numbers[0], 0.0)
    reference, smallest = table.select(turns[run.first]), math.inf
    for number in numbers[1:]:
        other = table.select(turns[number])
        shift = turn_shift(reference, other)
        smallest = min(smallest, shift)
        if shift <= limit_m:
            run = Still(run.first, number, max(run.shift_m, shift))
        else:
            run, reference = Still(number, number, 0.0), other
        best = run if run.turns > best.turns else best
    if best.turns < 2:
        raise InputError(_never_still(smallest, limit_m))
    return table.select((table["turn"] >= best.first) & (table["turn"] <= best.last)), best


def turn_shift(reference: ReturnTable, other: ReturnTable) -> float:
    """Return how much the measured distances differ between two revolutions, m.

    The distances of each laser in `reference` are interpolated to the azimuths of `other`. The
    median difference in each of 36 sectors of azimuth averages out noise. The result is the third
    quartile of these medians: it is large if the sensor moves, but a passing person does not affect
    it. It is inf if there are too few returns.
    """
    change, azimuth = _differences(reference, other)
    sector = np.floor(azimuth * (_SECTORS / math.tau)).astype(np.intp) % _SECTORS
    parts = [change[sector == number] for number in range(_SECTORS)]
    medians = [abs(float(np.median(part))) for part in parts if len(part) >= _LEAST_IN_SECTOR]
    if len(medians) < _LEAST_SECTORS:
        return math.inf
    return float(np.quantile(medians, 0.75))


def _turns(table: ReturnTable) -> dict[int, NDArray[np.intp]]:
    order = np.argsort(table["turn"], kind="stable")
    numbers, starts = np.unique(table["turn"][order], return_index=True)
    return dict(zip(numbers.tolist(), np.split(order, starts[1:]), strict=True))


def _differences(reference: ReturnTable, other: ReturnTable) -> tuple[Floats, Floats]:
    places, other_places = _places(reference), _places(other)
    order = np.argsort(places, kind="stable")
    places, distance = places[order], reference["distance"][order]
    after = np.clip(np.searchsorted(places, other_places), 1, len(places) - 1)
    gap = places[after] - places[after - 1]
    inside = (
        (other_places >= places[after - 1])
        & (other_places <= places[after])
        & (gap < _WIDEST_GAP_RAD)
    )
    step = distance[after] - distance[after - 1]
    change = other["distance"] - np.interp(other_places, places, distance)
    rows = inside & (np.abs(step) < _GREATEST_STEP_M)
    return change[rows], other["azimuth"][rows]


def _places(table: ReturnTable) -> Floats:
    return np.asarray(table["laser_id"] * _LASER_STRIDE + table["azimuth"])


def _never_still(shift_m: float, limit_m: float) -> str:
    seen = "too few returns of two turns compare"
    if math.isfinite(shift_m):
        seen = f"from turn to turn distances change by {1e3 * shift_m:.1f} mm or more"
    return f"the sensor never stands still: {seen} (limit {1e3 * limit_m:g} mm)"
