"""What an error model is: two hooks around the ray cast, and where its random numbers come from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.sensor.sensor import Sensor
from puckbench.sensor.sweep import Rays


@dataclass(frozen=True)
class Hits:
    """What the fired rays of some frames hit; arrays of shape (frames, steps, lasers).

    distance: m, inf for a ray without a hit in the sensor's range. triangle: index into the
    mesh's triangles, undefined without a hit. incidence: angle between ray and surface normal,
    rad in [0, pi/2], nan without a hit.
    """

    distance: Floats
    triangle: NDArray[np.uint32]
    incidence: Floats


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
        """The rays that are really fired; `rays` itself when they are the nominal ones."""

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """Measured distances, m, in the shape of ``hits.distance``.

        A distance that is not finite is no return: a miss stays one, and a model can take returns
        away (attenuation, raydrop).
        """
