"""What an error model is: the class to derive from, and what its methods are given."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import SceneObject
from pointkit.lidar.sensor import Sensor
from pointkit.models import Model
from pointkit.registry import Registry
from virtual_lidar.sweep import Rays

Distribution = Literal["gaussian", "laplace"]


@dataclass(frozen=True)
class Surfaces:
    """Objects of a labelled mesh, and the object to which each triangle belongs.

    Parameters
    ----------
    object_id
        Index of each triangle's object in `objects`, (t,); -1 for a triangle of no object.
    objects
        Names and semantic classes.
    """

    object_id: NDArray[np.int32]
    objects: tuple[SceneObject, ...]

    def values(self, by_name: Mapping[str, float], default: float) -> Floats:
        """Return a number for each triangle, (t,), that depends on the triangle's object.

        Parameters
        ----------
        by_name
            Numbers by the name of an object or by semantic class; the name has precedence.
        default
            Number for all other triangles.
        """
        numbers = [by_name.get(x.name, by_name.get(x.semantic, default)) for x in self.objects]
        return np.array([*numbers, default])[self.object_id]


@dataclass(frozen=True)
class Hits:
    """Where rays first meet the mesh, in arrays of shape (frames, azimuth steps, rays of a step).

    Parameters
    ----------
    distance
        Distances from the sensor, m; inf for a ray that meets nothing within the sensor's range.
    triangle
        Indices of the triangles hit; undefined where `distance` is inf.
    incidence
        Angles between ray and surface normal, rad, from 0 to pi / 2; nan where `distance` is inf.
    surfaces
        Objects of the mesh, or None for a mesh without labels.
    """

    distance: Floats
    triangle: NDArray[np.uint32]
    incidence: Floats
    surfaces: Surfaces | None = None

    def reshaped(self, shape: tuple[int, ...]) -> Hits:
        triangle, incidence = self.triangle.reshape(shape), self.incidence.reshape(shape)
        return Hits(self.distance.reshape(shape), triangle, incidence, self.surfaces)


class Draws:
    """Source of the random numbers of one scan: generators by name, all derived from one.

    A scan calls its error model for a few frames at a time. The result does not depend on how many,
    if each name is used for one purpose, and draws the same number of values for every ray (or, for
    a value per frame, for every frame).
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._key = rng.integers(2**32, size=4).tolist()
        self._running: dict[str, np.random.Generator] = {}

    def running(self, name: str) -> np.random.Generator:
        """Return the generator of this name, which continues where its last use ended.

        It is for values that differ from ray to ray or from frame to frame.
        """
        if name not in self._running:
            self._running[name] = self.fixed(name)
        return self._running[name]

    def fixed(self, name: str) -> np.random.Generator:
        """Return a generator of this name at the beginning of its sequence.

        It is for values that are the same in all frames of a scan, such as the lasers' biases.
        """
        digest = hashlib.sha256(name.encode()).digest()[:16]
        words = np.frombuffer(digest, dtype="<u4").tolist()
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(self._key + words)))


def standard_noise(
    stream: np.random.Generator, shape: tuple[int, ...], distribution: Distribution
) -> Floats:
    """Draw independent numbers with mean 0 and scale 1, in an array of the given shape.

    The scale is the standard deviation of ``"gaussian"`` and, as in BlenSor, the parameter b of
    ``"laplace"``, whose standard deviation is sqrt(2) b.
    """
    if distribution == "gaussian":
        return stream.standard_normal(shape)
    return stream.laplace(size=shape)


class ErrorModel(Model):
    """Base class of error models, which say how a measurement deviates from the truth.

    Fields of a subclass are its parameters, with the unit at the end of the name. A subclass
    overrides one or more of the methods, which by default leave rays, distances and points as they
    are. A scan calls them in the order `perturb_rays`, `merge_hits`, `perturb_ranges`,
    `lift_points`, for a few frames at a time. They must not keep anything from one call to the
    next, and draw random numbers for every ray, whether it hits or not, so that no ray affects
    another.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    title: ClassVar[str] = ""
    """Name of the model in figures; the default is its registered name."""
    colour: ClassVar[str] = ""
    """Colour of the model in figures, hexadecimal; the default derives from its name."""
    variant_of: ClassVar[type[ErrorModel] | None] = None
    """Model of which this class is a set of parameters; results store that model's name."""

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """Return the rays that are fired in place of the nominal ones.

        Parameters
        ----------
        rays
            Nominal rays, in arrays of shape (frames, azimuth steps, lasers).
        sensor
            The scanning sensor.
        draws
            Source of random numbers.

        Returns
        -------
        Rays
            Rays of the same shape or, from a model with `merge_hits`, k rays for each laser, next
            to each other: (frames, azimuth steps, lasers * k). `rays` itself saves a second ray
            casting.
        """
        return rays

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        """Return one hit for each laser, from the hits of all the rays that `perturb_rays` fired.

        Arrays of `hits` have the shape (frames, azimuth steps, lasers * k), those of the result
        (frames, azimuth steps, lasers).
        """
        return hits

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """Return the measured distances, m, in the shape of the true ones, ``hits.distance``.

        A distance that is inf or nan is no return: the ray hit nothing, or the model loses it.
        """
        return hits.distance

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        """Return by how much measured points are moved along the true surface normal, m.

        Positive values move points towards the sensor. The result has the shape of
        ``hits.distance``, and is finite even where that is not; None moves no point.
        """
        return None

    def described(self) -> dict[str, Any]:
        """Return the model's class name (``model``) and parameters, as scans store them."""
        kind = vars(type(self)).get("variant_of") or type(self)
        return {"model": kind.__name__, **self.model_dump()}

    def __str__(self) -> str:
        return repr(self)


ERROR_MODELS: Registry[type[ErrorModel]] = Registry("error model", "errors", "virtual_lidar")
"""Error models by name: ``@ERROR_MODELS.register("name")`` adds a class."""
