from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import NonNegativeFloat, PositiveInt

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from virtual_lidar.errors.model import ERROR_MODELS, Draws, Hits
from virtual_lidar.errors.vlp16 import BeamOfWidth
from virtual_lidar.sweep import Rays

CODE = ("virtual_lidar.errors.vlp16",)

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
Echo = Literal["first", "strongest", "last", "mean"]


@ERROR_MODELS.register("beam_footprint")
class BeamFootprint(BeamOfWidth):
    """Error model of a wide beam, which several rays sample; with the noise of `Vlp16`.

    The rays have equal energy, and cover the beam's elliptical cross-section in a sunflower pattern
    with a random rotation. Those that hit at similar ranges form an echo at their mean range, which
    lies between two surfaces where a beam hits both (a mixed pixel). The sensor measures one of the
    echoes, and places the point on the beam's axis. This model is not in the thesis.
    """

    sub_rays: PositiveInt = 9
    """Number of rays of a beam."""
    returns: Echo = "strongest"
    """Measured echo: the ``first``, the ``strongest`` (with most rays; the first of several such),
    the ``last``, or the ``mean`` of all hits."""
    merged_within_m: NonNegativeFloat = 0.9
    """Largest difference between successive ranges of an echo; the default is half the length of
    the VLP-16's pulse of 6 ns."""

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        turn = draws.running("footprint").random(rays.yaw.shape)[..., None] * (2 * np.pi)
        order = np.arange(self.sub_rays)
        radius = np.sqrt((order + 0.5) / self.sub_rays)
        angle = turn + order * _GOLDEN_ANGLE
        yaw_half, pitch_half = np.radians(self.beam_widths_deg(sensor)) / 2
        yaw = rays.yaw[..., None] + yaw_half * radius * np.cos(angle)
        pitch = rays.pitch[..., None] + pitch_half * radius * np.sin(angle)
        shape = (*rays.yaw.shape[:2], -1)
        return Rays(yaw.reshape(shape), pitch.reshape(shape), placed_as_fired=False)

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        apart = hits.distance.reshape(-1, self.sub_rays)
        distance, middle = echoes(apart, self.merged_within_m, self.returns)
        beams = np.arange(len(middle))
        triangle = hits.triangle.reshape(apart.shape)[beams, middle]
        incidence = hits.incidence.reshape(apart.shape)[beams, middle]
        merged = Hits(distance, triangle, incidence, hits.surfaces)
        return merged.reshaped((*hits.distance.shape[:2], sensor.lasers))


def echoes(apart: Floats, gap: float, choice: Echo) -> tuple[Floats, NDArray[np.intp]]:
    """Group the hits of each beam's rays into echoes, and choose one echo of each beam.

    Parameters
    ----------
    apart
        Distances of the rays' hits, (beams, rays), m; inf for a ray that hits nothing.
    gap
        Least distance between two echoes, m. Sorted by distance, a hit that is more than `gap`
        beyond the previous hit begins a new echo.
    choice
        The echo to choose, as in `BeamFootprint.returns`.

    Returns
    -------
    distances, nearest
        Mean distance of each chosen echo, (beams,), m, inf for a beam without a hit; and the index
        of the ray of this echo whose distance is nearest to the mean, (beams,).
    """
    from virtual_lidar.kernels import ECHOES, fill_echoes

    distances, nearest = np.empty(len(apart)), np.empty(len(apart), dtype=np.intp)
    fill_echoes(apart, gap, ECHOES.index(choice), distances, nearest)
    return distances, nearest
