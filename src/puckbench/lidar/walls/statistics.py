"""Noise of single rays and biases of single lasers, from what a sensor that stands still measures.

A deviation is what a measured range is longer than that of the plane, along the ray. A laser's bias
on a plane is its mean deviation there; the noise of a ray is how the deviations of one laser in one
direction spread from turn to turn, whatever its bias and whatever the wall's shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats
from puckbench.lidar.recordings import RecordedReturns
from puckbench.lidar.walls.detection import WALL, Surface, incidence
from puckbench.lidar.walls.residuals import RecordedPlanes

LEAST_TURNS = 3
"""Turns that a direction must return in, for its spread to count."""

_LEAST_RETURNS, _LEAST_COMMON_LASERS = 20, 6


@dataclass(frozen=True)
class RayNoise:
    """Spread of deviations over the turns, per laser and bin of azimuth.

    median_std_m: the median of the bins' standard deviations (n - 1). Of few turns it comes out
    too small: by 17 % with three, 11 % with four, 4 % with ten, for Gaussian noise.
    sigma_m: all bins' variances pooled by their degrees of freedom, which has no such bias.
    """

    median_std_m: float
    sigma_m: float
    bins: int


@dataclass(frozen=True)
class LaserBias:
    """Mean deviation of each laser (l,) on one plane, m, and its number of returns.

    The plane was fitted to the same returns, so that a bias that all lasers share, or that grows
    evenly with their elevation, has gone into the plane.
    """

    lasers: NDArray[np.intp]
    mean_m: Floats
    returns: NDArray[np.intp]

    @property
    def std_m(self) -> float | None:
        """Standard deviation (n - 1) over the lasers; None for fewer than two."""
        return float(np.std(self.mean_m, ddof=1)) if len(self.lasers) > 1 else None


@dataclass(frozen=True)
class Repeatability:
    """How far the lasers' biases on one plane are those on another, over all pairs of planes.

    correlation: mean of the pairs' correlations. shared_std_m: standard deviation of the part of
    the bias that a laser keeps from plane to plane (the root of the mean covariance; 0 for none).
    """

    pairs: int
    correlation: float
    shared_std_m: float


def range_deviation(residual: Floats, incidence: Floats) -> Floats:
    """Range minus that of the plane, m, of residuals positive on the sensor's side, (n,).

    incidence: angle between ray and normal, rad, below a right angle.
    """
    return np.asarray(-residual / np.cos(incidence))


def ray_noise(
    deviation: Floats,
    laser: NDArray[Any],
    azimuth: Floats,
    turn: NDArray[Any],
    step_rad: float,
    least_turns: int = LEAST_TURNS,
) -> RayNoise | None:
    """Spread of `deviation` (n,) over turns in bins of one laser and `step_rad` of azimuth.

    None when no bin has returns of `least_turns` turns, or the step is not known (nan).
    """
    if len(deviation) == 0 or np.isnan(step_rad):
        return None
    bins = np.column_stack([np.rint(azimuth / step_rad).astype(np.int64), laser])
    _, group = np.unique(bins, axis=0, return_inverse=True)
    counts = np.bincount(group)
    means = np.bincount(group, deviation) / counts
    squares = np.bincount(group, (deviation - means[group]) ** 2)
    enough = _turns_in(group, turn) >= least_turns
    if not enough.any():
        return None
    freedom = counts[enough] - 1
    stds = np.sqrt(squares[enough] / freedom)
    sigma = np.sqrt(squares[enough].sum() / freedom.sum())
    return RayNoise(float(np.median(stds)), float(sigma), int(np.count_nonzero(enough)))


def laser_bias(deviation: Floats, laser: NDArray[Any]) -> LaserBias:
    """Mean deviation of each laser with at least 20 returns on the plane."""
    counts = np.bincount(laser)
    lasers = np.flatnonzero(counts >= _LEAST_RETURNS)
    sums = np.bincount(laser, deviation)
    return LaserBias(lasers, sums[lasers] / counts[lasers], counts[lasers])


def repeatability(biases: Sequence[LaserBias]) -> Repeatability | None:
    """How far biases repeat from plane to plane; None without two that share six lasers."""
    correlations, covariances = [], []
    for one, other in combinations(biases, 2):
        _, first, second = np.intersect1d(one.lasers, other.lasers, return_indices=True)
        if len(first) >= _LEAST_COMMON_LASERS:
            table = np.cov(one.mean_m[first], other.mean_m[second])
            covariances.append(table[0, 1])
            correlations.append(table[0, 1] / max(np.sqrt(table[0, 0] * table[1, 1]), 1e-30))
    if not covariances:
        return None
    shared = float(np.sqrt(max(np.mean(covariances), 0.0)))
    return Repeatability(len(covariances), float(np.mean(correlations)), shared)


def azimuth_step(table: RecordedReturns) -> float:
    """The usual azimuth between two firings of a laser, rad; nan when no laser fired twice."""
    order = np.lexsort((table["azimuth"], table["laser_id"], table["turn"]))
    laser, turn = table["laser_id"][order], table["turn"][order]
    steps = np.diff(table["azimuth"][order])
    same = (np.diff(laser) == 0) & (np.diff(turn) == 0) & (steps > 0)
    return float(np.median(steps[same])) if same.any() else float("nan")


def _turns_in(group: NDArray[np.intp], turn: NDArray[Any]) -> NDArray[np.intp]:
    """Number of different turns in each group."""
    pairs = np.unique(np.column_stack([group, turn]), axis=0)
    return np.bincount(pairs[:, 0])


@dataclass(frozen=True)
class PlaneStatistics:
    """A surface of a recording with its rows' residuals (n,) and deviations along the ray (n,)."""

    surface: Surface
    rows: RecordedReturns
    residual: Floats
    deviation: Floats
    bias: LaserBias
    noise: RayNoise | None

    @property
    def unevenness_m(self) -> float | None:
        """What spreads the deviations besides biases and rays: the shape of the wall."""
        if self.noise is None or len(self.bias.lasers) == 0:
            return None
        means = np.zeros(int(self.rows["laser_id"].max()) + 1)
        means[self.bias.lasers] = self.bias.mean_m
        known = np.isin(self.rows["laser_id"], self.bias.lasers)
        rest = (self.deviation - means[self.rows["laser_id"]])[known]
        return math.sqrt(max(float(np.var(rest)) - self.noise.sigma_m**2, 0.0))

    def described(self) -> dict[str, Any]:
        """The statistics by name, for JSON; biases in m by laser."""
        biases = zip(self.bias.lasers.tolist(), self.bias.mean_m.tolist(), strict=True)
        return {
            "surface": self.surface.kind,
            "distance_m": self.surface.distance_m,
            "width_m": self.surface.width_m,
            "height_m": self.surface.height_m,
            "rows": len(self.rows),
            "lasers": len(np.unique(self.rows["laser_id"])),
            "std_m": float(self.residual.std(ddof=1)),
            "laser_bias_std_m": self.bias.std_m,
            "ray_noise": None if self.noise is None else asdict(self.noise),
            "unevenness_m": self.unevenness_m,
            "laser_bias_m": {str(laser): mean for laser, mean in biases},
        }


def plane_statistics(planes: RecordedPlanes) -> list[PlaneStatistics]:
    """Statistics of each plane of a recording."""
    step = azimuth_step(planes.table)
    return [_statistics(planes.table, surface, step) for surface in planes.surfaces]


def recording_summary(planes: RecordedPlanes) -> dict[str, Any]:
    """What the recording is, its statistics, its planes, and those not taken, for JSON.

    ray_noise is that of all planes together, laser_bias_std_m the root of the mean variance of the
    walls' biases; the rest is that of `RayNoise`, `LaserBias`, `Repeatability` and `Rejected`.
    """
    step, parts = azimuth_step(planes.table), plane_statistics(planes)
    walls = [part.bias for part in parts if part.surface.kind == WALL]
    stds = [bias.std_m for bias in walls if bias.std_m is not None]
    repeated, noise = repeatability(walls), _noise_of_all(parts, step)
    residuals = np.concatenate([part.residual for part in parts])
    return {
        **_about(planes),
        "rows": len(residuals),
        "mean_m": float(residuals.mean()),
        "std_m": float(residuals.std(ddof=1)),
        "ray_noise": None if noise is None else asdict(noise),
        "laser_bias_std_m": math.sqrt(float(np.mean(np.square(stds)))) if stds else None,
        "bias_repeatability": None if repeated is None else asdict(repeated),
        "planes": [part.described() for part in parts],
        "rejected": [_rejected(one.surface, one.reason) for one in planes.rejected],
    }


def _statistics(table: RecordedReturns, surface: Surface, step: float) -> PlaneStatistics:
    rows = table.select(surface.rows)
    residual = surface.plane.distances(rows.xyz)
    deviation = range_deviation(residual, incidence(rows, surface.plane))
    laser = rows["laser_id"]
    noise = ray_noise(deviation, laser, rows["azimuth"], rows["turn"], step)
    return PlaneStatistics(surface, rows, residual, deviation, laser_bias(deviation, laser), noise)


def _noise_of_all(parts: Sequence[PlaneStatistics], step: float) -> RayNoise | None:
    """Ray noise over all planes; a laser counts anew on each, where its bias may differ."""
    lasers = [part.rows["laser_id"] + 1000 * place for place, part in enumerate(parts)]
    azimuth, turn = (
        np.concatenate([part.rows[name] for part in parts]) for name in ("azimuth", "turn")
    )
    deviation = np.concatenate([part.deviation for part in parts])
    return ray_noise(deviation, np.concatenate(lasers), azimuth, turn, step)


def _about(planes: RecordedPlanes) -> dict[str, Any]:
    about, time = planes.table.about, planes.table["timestamp"]
    return {
        "capture": about["source"],
        "sensor": about["sensor"],
        "returns": about.get("returns"),
        "bytes_cut_off": about.get("bytes_cut_off", 0),
        "still_s": [float(time.min()), float(time.max())],
        "turns": len(np.unique(planes.table["turn"])),
        "shift_m": planes.still and planes.still.shift_m,
    }


def _rejected(surface: Surface, reason: str) -> dict[str, Any]:
    where = {"surface": surface.kind, "distance_m": surface.distance_m, "rows": len(surface.rows)}
    return {**where, "reason": reason}
