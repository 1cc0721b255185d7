"""What an error model is: hooks around the ray cast, and where its random numbers come from.

Most models need one of two hooks, `perturb_rays` before the cast and `perturb_ranges` after it. Two
more are there for a model that fires several rays per laser (`merge_hits`), and for one whose noise
is not along the ray (`lift_points`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from puckbench.core.models import Model
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import SceneObject
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays


@dataclass(frozen=True)
class Surfaces:
    """What the triangles of a labelled mesh belong to.

    Parameters
    ----------
    object_id
        (t,) index of each triangle's object in `objects`, or -1.
    objects
        The labelled objects of the scene.
    """

    object_id: NDArray[np.int32]
    objects: tuple[SceneObject, ...]

    def values(self, by_name: Mapping[str, float], default: float) -> Floats:
        """A number for each triangle, by the name of its object, or else by its semantic class.

        Parameters
        ----------
        by_name
            Name of an object, or semantic class -> number.
        default
            The number of all other triangles.

        Returns
        -------
        Floats
            (t,) numbers.
        """
        each = [by_name.get(one.name, by_name.get(one.semantic, default)) for one in self.objects]
        return np.array([*each, default])[self.object_id]


@dataclass(frozen=True)
class Hits:
    """What the fired rays of some frames hit; arrays of shape (frames, steps, rays of a step).

    Parameters
    ----------
    distance
        Metres; inf for a ray without a hit in the sensor's range.
    triangle
        Index into the mesh's triangles, undefined without a hit.
    incidence
        Angle between ray and surface normal, radians in [0, pi/2]; nan without a hit.
    surfaces
        What the triangles belong to; None where the mesh has no labels.
    """

    distance: Floats
    triangle: NDArray[np.uint32]
    incidence: Floats
    surfaces: Surfaces | None = None


class Draws:
    """Random streams of one scan, by name.

    A scan is worked on a few frames at a time. A stream goes on from one call of a hook to the
    next, so the numbers do not depend on how many frames that is, provided that a hook draws from
    each stream for one purpose only and a fixed number per ray or per frame.

    Parameters
    ----------
    rng
        The scan's generator, from which the key of its streams is drawn.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._key = rng.integers(2**32, size=4).tolist()
        self._running: dict[str, np.random.Generator] = {}

    def running(self, name: str) -> np.random.Generator:
        """The stream `name`, where the last call left it."""
        if name not in self._running:
            self._running[name] = self.fixed(name)
        return self._running[name]

    def fixed(self, name: str) -> np.random.Generator:
        """The stream `name` from its start: the same numbers at every call."""
        digest = hashlib.sha256(name.encode()).digest()[:16]
        words = np.frombuffer(digest, dtype="<u4").tolist()
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(self._key + words)))


class ErrorModel(Model):
    """The errors of a sensor: its parameters, with units in their names, and hooks around the cast.

    Without hooks of its own a model has no errors. The hooks are called for some frames at a time,
    in order, and must be pure functions of their arguments. They draw for every ray, hit or not, so
    that what one ray meets changes no other.
    """

    title: ClassVar[str] = ""
    """Name of the model in figures; without one its registered name."""
    colour: ClassVar[str] = ""
    """Colour of the model in figures, hexadecimal; without one it is drawn from its name."""
    variant_of: ClassVar[type[ErrorModel] | None] = None
    """The model of which this one is a set of parameters, under whose name results describe it."""

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """Give the rays that are really fired; `rays` itself when they are the nominal ones.

        Parameters
        ----------
        rays
            The nominal rays: yaw and pitch, (frames, steps, lasers), radians.
        sensor
            The virtual sensor, for its divergence and number of lasers.
        draws
            The scan's random streams.

        Returns
        -------
        Rays
            As many rays, or (of a model with `merge_hits`) k for each, one laser's after another's:
            (frames, steps, lasers * k).
        """
        return rays

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        """Give one hit per laser from those of all rays fired.

        Parameters
        ----------
        hits
            Of all fired rays, (frames, steps, lasers * k).
        sensor
            The virtual sensor.

        Returns
        -------
        Hits
            (frames, steps, lasers).
        """
        return hits

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """Give the measured distances.

        A distance that is not finite is no return: a miss stays one, and a model can take returns
        away (attenuation, raydrop).

        Parameters
        ----------
        hits
            One per laser, with the true distances.
        sensor
            The virtual sensor.
        draws
            The scan's random streams.

        Returns
        -------
        Floats
            Metres, in the shape of ``hits.distance``.
        """
        return hits.distance

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        """Give how far measured points move along the true normal, or None for not at all.

        The points are those of `perturb_ranges`; their measured distance becomes that from the
        sensor after the move.

        Parameters
        ----------
        hits
            One per laser, with the true distances.
        sensor
            The virtual sensor.
        draws
            The scan's random streams.

        Returns
        -------
        Floats or None
            Metres towards the sensor, in the shape of ``hits.distance``; finite for a miss too.
        """
        return None

    def described(self) -> dict[str, Any]:
        """The model's name and parameters, as they stand beside a result."""
        kind = vars(type(self)).get("variant_of") or type(self)
        return {"model": kind.__name__, **self.model_dump()}

    def __str__(self) -> str:
        return repr(self)


def described(model: ErrorModel) -> dict[str, Any]:
    """A model's name and parameters, and its receiver's if it has one."""
    return model.described()
