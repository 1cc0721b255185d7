"""A beam with a footprint: several rays over its cross-section, and one return made of them."""

from __future__ import annotations

from typing import Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import NonNegativeFloat, PositiveInt

from puckbench.lidar.errors.beam import BeamOfWidth
from puckbench.lidar.errors.model import Draws, Hits
from puckbench.lidar.errors.registry import ERROR_MODELS
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays

T = TypeVar("T", bound=np.generic)

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
# In the order that the compiled loop numbers them.
_Return = Literal["first", "strongest", "last", "mean"]


@ERROR_MODELS.register("beam_footprint")
class BeamFootprint(BeamOfWidth):
    """As `Vlp16`, for the return of a beam that is an ellipse of the sensor's divergence.

    Rays of equal energy lie over the ellipse in a sunflower pattern, turned at random about the
    axis of each beam. Near hits are one echo, at the mean of its ranges (a mixed pixel). The return
    is placed along the nominal ray.

    Parameters
    ----------
    sub_rays
        Rays of a beam.
    returns
        Which echo returns: the ``first``, the ``strongest`` (of most rays; the first of equals),
        the ``last``, or the ``mean`` of everything hit.
    merged_within_m
        Hits no farther than this from the next in range are one echo; by default half the length
        of a pulse of 6 ns, the VLP-16's.
    """

    title, colour = "Beam footprint", "#999933"

    sub_rays: PositiveInt = 9
    returns: _Return = "strongest"
    merged_within_m: NonNegativeFloat = 0.9

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """The rays of each beam, one beam's after another's: (frames, steps, lasers * sub_rays)."""
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
        """The echo that returns from each beam, with the triangle and incidence in its middle."""
        from puckbench.lidar.kernels import fill_echoes

        shape = (*hits.distance.shape[:2], sensor.lasers)
        apart = hits.distance.reshape(-1, self.sub_rays)
        distance, middle = np.empty(len(apart)), np.empty(len(apart), dtype=np.int64)
        fill_echoes(
            apart, self.merged_within_m, get_args(_Return).index(self.returns), distance, middle
        )
        return Hits(
            distance.reshape(shape),
            _taken(hits.triangle, middle).reshape(shape),
            _taken(hits.incidence, middle).reshape(shape),
            hits.surfaces,
        )


def _taken(values: NDArray[T], middle: NDArray[np.int64]) -> NDArray[T]:
    """Of each beam's values the one of its middle ray, (beams,)."""
    beams = values.reshape(len(middle), -1)
    return np.asarray(beams[np.arange(len(middle)), middle])
