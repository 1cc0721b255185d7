"""What an error model is: hooks around the ray cast, and where its random numbers come from.

Two hooks make a model, `perturb_rays` before the cast and `perturb_ranges` after it. Two more are
there for the models that need them: `merge_hits` for one that fires several rays per laser, and
`lift_points` for one whose noise is not along the ray.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import SceneObject
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays


@dataclass(frozen=True)
class Surfaces:
    """What the triangles of a labelled mesh belong to.

    object_id: (t,) index into `objects`, or -1.
    """

    object_id: NDArray[np.int32]
    objects: tuple[SceneObject, ...]

    def values(self, by_name: Mapping[str, float], default: float) -> Floats:
        """A number for each triangle, (t,): by its object's name, or else by its class."""
        each = [by_name.get(one.name, by_name.get(one.semantic, default)) for one in self.objects]
        return np.array([*each, default])[self.object_id]


@dataclass(frozen=True)
class Hits:
    """What the fired rays of some frames hit; arrays of shape (frames, steps, rays of a step).

    distance: m, inf for a ray without a hit in the sensor's range. triangle: index into the
    mesh's triangles, undefined without a hit. incidence: angle between ray and surface normal,
    rad in [0, pi/2], nan without a hit. surfaces: None where the mesh has no labels.
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


class ErrorModel(Protocol):
    """The errors of a sensor: a frozen dataclass of parameters, units in their names.

    The hooks are called for some frames at a time, in order, and must be pure functions of their
    arguments. They draw for every ray, hit or not, so that what one ray meets changes no other.
    """

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """The rays that are really fired; `rays` itself when they are the nominal ones.

        They are as many, or (a model with `merge_hits`) k for each, one laser's after another's:
        (frames, steps, lasers * k).
        """

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """Measured distances, m, in the shape of ``hits.distance``.

        A distance that is not finite is no return: a miss stays one, and a model can take returns
        away (attenuation, raydrop).
        """


@runtime_checkable
class SplitsRays(Protocol):
    """A model that fires several rays for each nominal one."""

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        """One hit per laser from those of all rays fired, (frames, steps, lasers)."""


@runtime_checkable
class LeavesRay(Protocol):
    """A model whose noise has a part along the normal of the surface."""

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        """How far measured points move along the true normal towards the sensor, m, or None.

        In the shape of ``hits.distance``; finite. The points are those of `perturb_ranges`; their
        measured distance becomes that from the sensor after the move.
        """


def merged(model: ErrorModel, hits: Hits, sensor: Sensor) -> Hits:
    """The hits per laser: the model's `merge_hits` where it has one, else `hits`."""
    return model.merge_hits(hits, sensor) if isinstance(model, SplitsRays) else hits


def lifted(model: ErrorModel, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
    """The model's `lift_points` where it has one, else None."""
    return model.lift_points(hits, sensor, draws) if isinstance(model, LeavesRay) else None
