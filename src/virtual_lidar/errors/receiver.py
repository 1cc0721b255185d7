from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, NonNegativeFloat, PositiveFloat

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from pointkit.models import Model
from virtual_lidar.errors.model import Draws, ErrorModel, Hits, Surfaces
from virtual_lidar.sweep import Rays


class Receiver(Model):
    """Loss of returns in a sensor's receiver; the defaults lose none within 140 m.

    Attenuation, as in BlenSor's code (equation 5.3 of the thesis has a misprint): from the true
    distance d = `attenuation_from_m` on, a return needs a diffuse reflectivity of at least
    ``attenuation_limit + attenuation_slope_per_m * (d - attenuation_from_m)``. Raydrop: a return
    whose ray meets the surface at the incidence theta is lost with the probability ``raydrop +
    raydrop_incidence * (1 - cos theta) + raydrop_per_m * d``.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    reflectivity: dict[str, Annotated[float, Field(ge=0, le=1)]] = Field(default={})
    """Diffuse reflectivities, 0 to 1, by the object's name or else semantic class."""
    default_reflectivity: NonNegativeFloat = 1.0
    """Diffuse reflectivity of objects that `reflectivity` omits."""
    attenuation_from_m: NonNegativeFloat = 50.0
    """Distance from which on a return must be bright enough."""
    attenuation_limit: NonNegativeFloat = 0.1
    """Least reflectivity at that distance."""
    attenuation_slope_per_m: NonNegativeFloat = 0.01
    """Increase of the least reflectivity per metre beyond that distance."""
    raydrop: NonNegativeFloat = 0.0
    """Probability of a loss at perpendicular incidence and distance 0."""
    raydrop_incidence: NonNegativeFloat = 0.0
    """Increase of the probability from perpendicular to grazing incidence."""
    raydrop_per_m: NonNegativeFloat = 0.0
    """Increase of the probability per metre of distance."""
    min_range_m: NonNegativeFloat = 0.0
    """Returns with a shorter measured distance are lost."""
    range_quantum_mm: PositiveFloat | None = None
    """Measured distances are rounded to multiples of this quantum."""
    mirrors: tuple[str, ...] = ()
    """Names or semantic classes of mirrors. As in BlenSor, an object in a mirror is measured along
    the fired ray at the length of the reflected path; true values are those of the mirror. Glass is
    opaque."""

    def received(self, measured: Floats, hits: Hits, draws: Draws) -> Floats:
        """Return the distances that the receiver reports, with inf for each return that it loses.

        Parameters
        ----------
        measured
            Measured distances, m, which are rounded to the range quantum.
        hits
            True hits, in arrays of the same shape.
        draws
            Source of random numbers.
        """
        lost = self._too_dark(hits) | self._dropped(hits, draws)
        if self.range_quantum_mm is not None:
            quantum = self.range_quantum_mm * 1e-3
            measured = np.round(measured / quantum) * quantum
        lost |= measured < self.min_range_m
        return np.where(lost, np.inf, measured)

    def _too_dark(self, hits: Hits) -> NDArray[np.bool_]:
        beyond = hits.distance - self.attenuation_from_m
        far = np.isfinite(hits.distance) & (hits.distance >= self.attenuation_from_m)
        needed = self.attenuation_limit + self.attenuation_slope_per_m * beyond
        return np.asarray(far & (self._reflectivity(hits, far) < needed))

    def _reflectivity(self, hits: Hits, where: NDArray[np.bool_]) -> Floats:
        if not self.reflectivity:
            return np.full(hits.distance.shape, self.default_reflectivity)
        if hits.surfaces is None:
            raise InputError("reflectivity is given by object, but the mesh has no labels")
        by_triangle = hits.surfaces.values(self.reflectivity, self.default_reflectivity)
        return by_triangle[np.where(where, hits.triangle, 0)]

    def _dropped(self, hits: Hits, draws: Draws) -> NDArray[np.bool_]:
        if not (self.raydrop or self.raydrop_incidence or self.raydrop_per_m):
            return np.zeros(hits.distance.shape, dtype=np.bool_)
        probability = self.raydrop + self.raydrop_incidence * (1 - np.cos(hits.incidence))
        probability += self.raydrop_per_m * np.where(np.isfinite(hits.distance), hits.distance, 0)
        return np.asarray(draws.running("raydrop").random(hits.distance.shape) < probability)

    def mirrored(self, surfaces: Surfaces | None) -> NDArray[np.bool_] | None:
        """Return a mask (t,) of the mesh's triangles that are mirrors; None if `mirrors` is empty.

        Parameters
        ----------
        surfaces
            Objects of the mesh; None for a mesh without labels.

        Raises
        ------
        InputError
            There are mirrors, but the mesh has no labels.
        """
        if not self.mirrors:
            return None
        if surfaces is None:
            raise InputError("mirrors are given by object, but the mesh has no labels")
        return surfaces.values(dict.fromkeys(self.mirrors, 1.0), 0.0) > 0


class Received(ErrorModel):
    """Error model that combines another error model with a receiver, which may lose returns."""

    model: ErrorModel
    receiver: Receiver

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        return self.model.perturb_rays(rays, sensor, draws)

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        return self.model.merge_hits(hits, sensor)

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        measured = self.model.perturb_ranges(hits, sensor, draws)
        return self.receiver.received(measured, hits, draws)

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        return self.model.lift_points(hits, sensor, draws)

    def described(self) -> dict[str, Any]:
        return {**self.model.described(), "receiver": self.receiver.model_dump()}
