"""What becomes of a return at the receiver: lost when dark, at random or near; ranges in steps.

These effects go on top of any error model: they are applied, in the order of the fields, to the
distances that the model measured.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, PositiveFloat

from puckbench.core.errors import InputError
from puckbench.core.models import Model
from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Draws, ErrorModel, Hits, Surfaces
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays


class Receiver(Model):
    """The losses of a receiver and its steps of the range; the defaults lose nothing within 140 m.

    Attenuation, as BlenSor has it in code (equation 5.3 of the thesis misprints it): a return at a
    true distance d of `attenuation_from_m` or more needs a diffuse reflectivity of at least
    ``attenuation_limit + attenuation_slope_per_m * (d - attenuation_from_m)``; nearer ones always
    return. Raydrop: a return is lost with the probability ``raydrop + raydrop_incidence * (1 - cos
    theta) + raydrop_per_m * d``, at most 1, theta being the incidence angle.

    Parameters
    ----------
    reflectivity
        By the name or else the semantic class of an object, from 0 to 1.
    default_reflectivity
        Of all other objects.
    attenuation_from_m, attenuation_limit, attenuation_slope_per_m
        As in the formula above.
    raydrop, raydrop_incidence, raydrop_per_m
        As in the formula above.
    min_range_m
        Nearer measured distances are lost.
    range_quantum_mm
        Measured distances are multiples of it; None for any distance.
    mirrors
        Names or semantic classes of objects that reflect like a mirror, as in BlenSor: an object
        in the mirror is measured along the fired ray, at the length of the path; the mirror itself
        never returns. The true values of such a row are those of the mirror. Glass is opaque, as
        in BlenSor.
    """

    reflectivity: dict[str, Annotated[float, Field(ge=0, le=1)]] = Field(default={})
    default_reflectivity: NonNegativeFloat = 1.0
    attenuation_from_m: NonNegativeFloat = 50.0
    attenuation_limit: NonNegativeFloat = 0.1
    attenuation_slope_per_m: NonNegativeFloat = 0.01
    raydrop: NonNegativeFloat = 0.0
    raydrop_incidence: NonNegativeFloat = 0.0
    raydrop_per_m: NonNegativeFloat = 0.0
    min_range_m: NonNegativeFloat = 0.0
    range_quantum_mm: PositiveFloat | None = None
    mirrors: tuple[str, ...] = ()

    def received(self, measured: Floats, hits: Hits, draws: Draws) -> Floats:
        """Let measured distances through.

        Parameters
        ----------
        measured
            Metres, in the shape of ``hits.distance``.
        hits
            What the rays really met.
        draws
            The scan's random streams.

        Returns
        -------
        Floats
            Metres, in steps of the range quantum; inf where a return is lost.

        Raises
        ------
        InputError
            Reflectivity is given by object, but the mesh has no labels.
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
        """Reflectivity at the hits, in their shape; undefined but `where`."""
        if not self.reflectivity:
            return np.full(hits.distance.shape, self.default_reflectivity)
        if hits.surfaces is None:
            raise InputError("reflectivity is given by object, but the mesh has no labels")
        each = hits.surfaces.values(self.reflectivity, self.default_reflectivity)
        return each[np.where(where, hits.triangle, 0)]

    def _dropped(self, hits: Hits, draws: Draws) -> NDArray[np.bool_]:
        if not (self.raydrop or self.raydrop_incidence or self.raydrop_per_m):
            return np.zeros(hits.distance.shape, dtype=np.bool_)
        chance = self.raydrop + self.raydrop_incidence * (1 - np.cos(hits.incidence))
        chance += self.raydrop_per_m * np.where(np.isfinite(hits.distance), hits.distance, 0)
        return np.asarray(draws.running("raydrop").random(hits.distance.shape) < chance)


class Received(ErrorModel):
    """An error model whose returns go through a receiver.

    Parameters
    ----------
    model
        Of the rays and ranges.
    receiver
        What the returns go through.
    """

    model: ErrorModel
    receiver: Receiver

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """The model's rays."""
        return self.model.perturb_rays(rays, sensor, draws)

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        """The model's hits."""
        return self.model.merge_hits(hits, sensor)

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """The model's distances as the receiver lets them through."""
        measured = self.model.perturb_ranges(hits, sensor, draws)
        return self.receiver.received(measured, hits, draws)

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        """The model's displacements along the normal."""
        return self.model.lift_points(hits, sensor, draws)

    def described(self) -> dict[str, Any]:
        """The model's description with the receiver's parameters."""
        return {**self.model.described(), "receiver": self.receiver.model_dump()}


def mirrors_of(model: ErrorModel, surfaces: Surfaces | None) -> NDArray[np.bool_] | None:
    """Find the triangles that are mirrors to a model's receiver.

    Parameters
    ----------
    model
        Any error model, with a receiver or without.
    surfaces
        What the triangles belong to; None for a mesh without labels.

    Returns
    -------
    NDArray of bool or None
        (t,); None when the receiver knows no mirrors.

    Raises
    ------
    InputError
        The receiver knows mirrors, but the mesh has no labels.
    """
    names = model.receiver.mirrors if isinstance(model, Received) else ()
    if not names:
        return None
    if surfaces is None:
        raise InputError("mirrors are given by object, but the mesh has no labels")
    return surfaces.values(dict.fromkeys(names, 1.0), 0.0) > 0
