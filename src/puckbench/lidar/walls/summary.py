"""Statistics of a real capture's plane residuals: of each plane, and of all together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.lidar.recordings import CaptureTable
from puckbench.lidar.walls.detection import WALL, Surface, incidence
from puckbench.lidar.walls.ray_statistics import (
    LaserBias,
    RayNoise,
    azimuth_step,
    laser_bias,
    range_deviation,
    ray_noise,
    repeatability,
)
from puckbench.lidar.walls.residuals import CapturedPlanes


@dataclass(frozen=True)
class PlaneStatistics:
    """A surface of a capture, its rows, their residuals (n,) and deviations along the ray (n,)."""

    surface: Surface
    rows: CaptureTable
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


def plane_statistics(planes: CapturedPlanes) -> list[PlaneStatistics]:
    """Statistics of each plane of a capture."""
    step = azimuth_step(planes.table)
    return [_statistics(planes.table, surface, step) for surface in planes.surfaces]


def capture_summary(planes: CapturedPlanes) -> dict[str, Any]:
    """What the capture is, its statistics, its planes, and those not taken, for JSON.

    ray_noise is that of all planes together, laser_bias_std_m the root of the mean variance of the
    walls' biases; the rest is told by `RayNoise`, `LaserBias`, `Repeatability` and `Rejected`.
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


def _statistics(table: CaptureTable, surface: Surface, step: float) -> PlaneStatistics:
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


def _about(planes: CapturedPlanes) -> dict[str, Any]:
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
