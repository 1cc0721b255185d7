from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import SceneObject
from pointkit.lidar.sensor import Sensor
from pointkit.models import Model
from virtual_lidar.sweep import Rays


@dataclass(frozen=True)
class Surfaces:
    """Objects of a labelled mesh, and the index (t,) of each triangle's object (-1: none)."""

    object_id: NDArray[np.int32]
    objects: tuple[SceneObject, ...]

    def values(self, by_name: Mapping[str, float], default: float) -> Floats:
        """Look up each triangle's value, (t,), by its object's name, then by semantic class."""
        numbers = [by_name.get(x.name, by_name.get(x.semantic, default)) for x in self.objects]
        return np.array([*numbers, default])[self.object_id]


@dataclass(frozen=True)
class Hits:
    """Hits of the rays of successive frames; arrays are (frames, azimuth steps, rays of a step).

    `incidence` is the angle between ray and surface normal, rad. Without a hit in the sensor's
    range, `distance`, m, is inf, `incidence` is nan, and `triangle` is undefined.
    """

    distance: Floats
    triangle: NDArray[np.uint32]
    incidence: Floats
    surfaces: Surfaces | None = None

    def reshaped(self, shape: tuple[int, ...]) -> Hits:
        triangle, incidence = self.triangle.reshape(shape), self.incidence.reshape(shape)
        return Hits(self.distance.reshape(shape), triangle, incidence, self.surfaces)


class Draws:
    """Named random generators of one scan, all derived from the scan's generator.

    Results do not depend on the number of frames per call if each generator has one purpose and a
    fixed number of draws for each ray or frame.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._key = rng.integers(2**32, size=4).tolist()
        self._running: dict[str, np.random.Generator] = {}

    def running(self, name: str) -> np.random.Generator:
        """Return a generator that continues where its last use ended."""
        if name not in self._running:
            self._running[name] = self.fixed(name)
        return self._running[name]

    def fixed(self, name: str) -> np.random.Generator:
        """Return a new generator, at the beginning of its sequence."""
        digest = hashlib.sha256(name.encode()).digest()[:16]
        words = np.frombuffer(digest, dtype="<u4").tolist()
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(self._key + words)))


class ErrorModel(Model):
    """Base class of error models: parameters with units in their names, and methods to override.

    The methods are called for successive groups of frames, and by default change nothing. They must
    be pure functions of their arguments, and draw random numbers for every ray, hit or not, so that
    rays do not affect each other.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    title: ClassVar[str] = ""
    """Name of the model in figures; the default is its registered name."""
    colour: ClassVar[str] = ""
    """Colour of the model in figures, hexadecimal; the default derives from its name."""
    variant_of: ClassVar[type[ErrorModel] | None] = None
    """Model of which this class is a set of parameters; results store that model's name."""

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """Return the fired rays for the nominal `rays` (frames, steps, lasers).

        A model with `merge_hits` may fire k rays for each nominal one, laser by laser: (frames,
        steps, lasers * k). Return `rays` itself to fire the nominal ones.
        """
        return rays

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        """Combine the hits of all fired rays (frames, steps, lasers * k) into one per laser."""
        return hits

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """Return the measured distances, m, in the shape of the true ones, ``hits.distance``.

        A distance that is not finite is not a return: a miss, or a return that the model removes.
        """
        return hits.distance

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        """Return displacements of measured points along the true normal, towards the sensor, m.

        Displacements have the shape of ``hits.distance`` and are finite even for a miss; None means
        0.
        """
        return None

    def described(self) -> dict[str, Any]:
        """Return the model's name and parameters, as results store them."""
        kind = vars(type(self)).get("variant_of") or type(self)
        return {"model": kind.__name__, **self.model_dump()}

    def __str__(self) -> str:
        return repr(self)
