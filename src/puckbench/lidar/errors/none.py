"""No errors: the null strategy."""

from __future__ import annotations

from dataclasses import dataclass

from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Draws, Hits
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays


@dataclass(frozen=True)
class NoErrors:
    """Nominal rays, true distances."""

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """The nominal rays."""
        return rays

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """The true distances."""
        return hits.distance
