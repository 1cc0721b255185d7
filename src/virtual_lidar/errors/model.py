"""The base class of error models, and the records that its methods take."""

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
    """The objects of a labelled mesh, and which triangle belongs to which object.

    Parameters
    ----------
    object_id
        Index in `objects` of each triangle's object, (t,); -1 for a triangle that belongs to none.
    objects
        Name and semantic class of each object.
    """

    object_id: NDArray[np.int32]
    objects: tuple[SceneObject, ...]

    def values(self, by_name: Mapping[str, float], default: float) -> Floats:
        """Return a number for each triangle, (t,), by the name or class of its object.

        Parameters
        ----------
        by_name
            The numbers, by name or by semantic class of an object. A name has precedence over a
            class.
        default
            The number for triangles of all other objects and of no object.
        """
        numbers = [by_name.get(x.name, by_name.get(x.semantic, default)) for x in self.objects]
        return np.array([*numbers, default])[self.object_id]


@dataclass(frozen=True)
class Hits:
    """Where rays first meet the mesh.

    All arrays have the shape (frames, azimuth steps, rays of an azimuth step).

    Parameters
    ----------
    distance
        Distances from the sensor, m; inf for a ray that meets nothing within the sensor's range.
    triangle
        Numbers of the triangles that are hit; undefined where `distance` is inf.
    incidence
        Angles between the rays and the surface normals, rad, from 0 to pi / 2; nan where `distance`
        is inf.
    surfaces
        Objects of the mesh; None for a mesh without labels.
    """

    distance: Floats
    triangle: NDArray[np.uint32]
    incidence: Floats
    surfaces: Surfaces | None = None

    def reshaped(self, shape: tuple[int, ...]) -> Hits:
        triangle, incidence = self.triangle.reshape(shape), self.incidence.reshape(shape)
        return Hits(self.distance.reshape(shape), triangle, incidence, self.surfaces)


class Draws:
    """Source of the random numbers of one scan: random generators that are identified by names.

    A scan calls its error model for a few frames at a time. The result does not depend on the
    number of these frames if the model keeps two rules: it uses each name for only one purpose, and
    it draws the same number of values for every ray (or for every frame).
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._key = rng.integers(2**32, size=4).tolist()
        self._running: dict[str, np.random.Generator] = {}

    def running(self, name: str) -> np.random.Generator:
        """Return the generator with this name, which continues where its last use ended.

        Use it for values that differ between rays or between frames.
        """
        if name not in self._running:
            self._running[name] = self.fixed(name)
        return self._running[name]

    def fixed(self, name: str) -> np.random.Generator:
        """Return the generator with this name, always at the beginning of its sequence.

        Use it for values that are the same in all frames of a scan, such as biases of lasers.
        """
        digest = hashlib.sha256(name.encode()).digest()[:16]
        words = np.frombuffer(digest, dtype="<u4").tolist()
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(self._key + words)))


def standard_noise(
    stream: np.random.Generator, shape: tuple[int, ...], distribution: Distribution
) -> Floats:
    """Draw independent random numbers with mean 0 and scale 1.

    The scale of ``"gaussian"`` is the standard deviation. The scale of ``"laplace"`` is the
    parameter b, as in BlenSor; its standard deviation is sqrt(2) b.

    Parameters
    ----------
    stream
        Generator from which the numbers are drawn.
    shape
        Shape of the array that is returned.
    distribution
        ``"gaussian"`` or ``"laplace"``.
    """
    if distribution == "gaussian":
        return stream.standard_normal(shape)
    return stream.laplace(size=shape)


class ErrorModel(Model):
    """Base class of error models: how measurements in virtual scans deviate from the truth.

    The fields of a subclass are its parameters; the name of a field ends with its unit. A subclass
    overrides one or more of the methods below, which by default leave rays, distances and points as
    they are. A scan calls the methods in the order `perturb_rays`, `merge_hits`, `perturb_ranges`,
    `lift_points`, for a few frames at a time; it may call `perturb_rays` for the next frames
    earlier. The methods must keep nothing from one call to the next. They must draw random numbers
    for every ray, whether it hits or not, so that no ray affects another.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    title: ClassVar[str] = ""
    """Name of the model in figures; the default is its registered name."""
    colour: ClassVar[str] = ""
    """Colour of the model in figures, hexadecimal; the default derives from its name."""
    variant_of: ClassVar[type[ErrorModel] | None] = None
    """Model of which this class is a set of parameters; results store that model's name."""

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """Return the rays that the sensor really fires in place of the nominal rays.

        Parameters
        ----------
        rays
            Nominal rays, i.e. those that the sensor reports, in arrays of shape (frames, azimuth
            steps, lasers).
        sensor
            The scanning sensor.
        draws
            Source of random numbers.

        Returns
        -------
        Rays
            Rays of the same shape. A model that overrides `merge_hits` may return k rays for each
            laser next to each other: (frames, azimuth steps, lasers * k). A model that changes no
            ray should return `rays` itself, since this saves a second ray casting.
        """
        return rays

    def merge_hits(self, hits: Hits, sensor: Sensor) -> Hits:
        """Return one hit for each laser, if `perturb_rays` fired several rays for each laser.

        Parameters
        ----------
        hits
            Hits of all rays, in arrays of shape (frames, azimuth steps, lasers * k).
        sensor
            The scanning sensor.

        Returns
        -------
        Hits
            Arrays of shape (frames, azimuth steps, lasers).
        """
        return hits

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """Return the measured distances for the true distances ``hits.distance``.

        Parameters
        ----------
        hits
            True hits of the fired rays, in arrays of shape (frames, azimuth steps, lasers).
        sensor
            The scanning sensor.
        draws
            Source of random numbers.

        Returns
        -------
        array
            Measured distances, m, in the shape of ``hits.distance``. A value of inf or nan means
            that there is no return, because the ray hit nothing or because the model loses the
            return.
        """
        return hits.distance

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        """Return by how much measured points are moved along the true surface normal.

        Parameters
        ----------
        hits
            True hits of the fired rays, in arrays of shape (frames, azimuth steps, lasers).
        sensor
            The scanning sensor.
        draws
            Source of random numbers.

        Returns
        -------
        array or None
            Lengths, m, in the shape of ``hits.distance``; positive lengths move points towards the
            sensor. They are finite even where the distance is not. None means that no point is
            moved.
        """
        return None

    def described(self) -> dict[str, Any]:
        """Return the class name (``model``) and the parameters of the model, as scans store it."""
        kind = vars(type(self)).get("variant_of") or type(self)
        return {"model": kind.__name__, **self.model_dump()}

    def __str__(self) -> str:
        return repr(self)


ERROR_MODELS: Registry[type[ErrorModel]] = Registry("error model", "errors", "virtual_lidar")
"""Error models by name: ``@ERROR_MODELS.register("name")`` adds a class."""
