"""Triangle meshes, optionally labelled with the object and the primitive of each triangle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

_CHECKED_FIRST = 1000
_POSITIONS = ("point", "centre", "apex")
_LENGTHS = ("radius", "major_radius", "minor_radius", "sizes")
"""Names of primitives' parameters that are positions or lengths."""


@dataclass(frozen=True)
class Primitive:
    """A geometric primitive on which a part of a surface lies (thesis, section 7).

    Parameters
    ----------
    kind
        "plane", "cylinder", "sphere", "cone", "torus", "superquadric" or "freeform".
    parameters
        Parameters by name, in world coordinates (metres, radians); directions are unit vectors. A
        plane has ``normal`` and ``offset`` (normal . p = offset). A cylinder has ``point``,
        ``axis`` and ``radius``. A sphere has ``centre`` and ``radius``. A cone has ``apex``,
        ``axis`` (which points into the cone) and ``half_angle``. A torus has ``centre``, ``axis``,
        ``major_radius`` and ``minor_radius``. A superquadric has ``centre``, ``axes``, ``sizes``
        and ``exponents``.
    """

    kind: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class SceneObject:
    """An object in a scene.

    Parameters
    ----------
    name
        Unique name, such as ``"chair_3"``.
    semantic
        Semantic class, such as ``"chair"``.
    """

    name: str
    semantic: str


@dataclass(frozen=True)
class Labels:
    """Object and geometric primitive to which each of t triangles of a scene belongs.

    Parameters
    ----------
    object_id, primitive_id
        Index into `objects`, and index into `primitives`, of each triangle, (t,).
    objects
        The objects of the scene.
    primitives
        The geometric primitives on which triangles lie.
    """

    object_id: NDArray[np.int32]
    primitive_id: NDArray[np.int32]
    objects: tuple[SceneObject, ...]
    primitives: tuple[Primitive, ...]


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with z up, optionally with labels.

    Parameters
    ----------
    vertices
        Coordinates (v, 3), m.
    triangles
        Indices (t, 3) of the vertices of each triangle.
    labels
        Object and primitive of each triangle, or None.
    """

    vertices: Floats
    triangles: NDArray[np.int64]
    labels: Labels | None = None

    def corners(self) -> Floats:
        """Return the coordinates of the triangles' vertices, (t, 3, 3): triangle, vertex, axis."""
        return self.vertices[self.triangles]

    def areas(self) -> Floats:
        """Return the areas (t,) of the triangles, square metres."""
        return np.asarray(np.linalg.norm(self._doubled_areas(), axis=1) / 2)

    def normals(self) -> Floats:
        """Return the triangles' unit normals (t, 3); triangles without area have zero normals."""
        doubled = self._doubled_areas()
        lengths = np.linalg.norm(doubled, axis=1, keepdims=True)
        return np.asarray(
            np.divide(doubled, lengths, where=lengths > 0, out=np.zeros_like(doubled))
        )

    def bounds(self) -> Floats:
        """Return the lowest and the highest corner (2, 3) of the vertices that triangles use."""
        used = self.vertices[np.unique(self.triangles)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    def _doubled_areas(self) -> Floats:
        a, b, c = self.corners().swapaxes(0, 1)
        return np.asarray(np.cross(b - a, c - a))


def primitive_in_metres(primitive: Primitive, scale: float, offset: Floats) -> Primitive:
    """Convert a primitive from a scaled frame to metres.

    A coordinate in metres is ``scaled / scale + offset``.
    """
    parameters = dict(primitive.parameters)
    for name in _LENGTHS:
        if name in parameters:
            parameters[name] = (np.asarray(parameters[name]) / scale).tolist()
    for name in _POSITIONS:
        if name in parameters:
            parameters[name] = (np.asarray(parameters[name]) / scale + offset).tolist()
    if "normal" in parameters:
        shift = np.dot(parameters["normal"], offset)
        parameters["offset"] = float(parameters["offset"] / scale + shift)
    return Primitive(primitive.kind, parameters)


def labelled_mesh_in_metres(mesh: Mesh, scale: float, offset: Floats) -> Mesh:
    """Convert a labelled mesh from a scaled frame to metres.

    A coordinate in metres is ``scaled / scale + offset``.
    """
    labels = _labels_in_metres(mesh.labels, scale, offset)
    return Mesh(mesh.vertices / scale + offset, mesh.triangles, labels)


def scaled_mesh(mesh: Mesh, metres_per_unit: float) -> Mesh:
    """Return a mesh, and its primitives, converted from another unit to metres."""
    labels = mesh.labels
    if metres_per_unit != 1:
        labels = _labels_in_metres(labels, 1 / metres_per_unit, np.zeros(3))
    return Mesh(mesh.vertices * metres_per_unit, mesh.triangles, labels)


def _labels_in_metres(labels: Labels | None, scale: float, offset: Floats) -> Labels | None:
    if labels is None:
        return None
    primitives = tuple(primitive_in_metres(each, scale, offset) for each in labels.primitives)
    return replace(labels, primitives=primitives)


def check_mesh(mesh: Mesh, source: str) -> None:
    """Raise InputError for a mesh without area, with invalid indices, or that is not finite.

    The message begins with `source`.
    """
    if len(mesh.triangles) == 0:
        raise InputError(f"{source}: the mesh has no faces")
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
        raise InputError(f"{source}: a face refers to a vertex that does not exist")
    not_finite = np.asarray(~np.isfinite(mesh.vertices).all(axis=1))
    if not_finite.any() and not_finite[mesh.triangles].any():
        raise InputError(f"{source}: a face has a vertex that is not finite")
    # The first triangles usually suffice; all of them take as long as all other checks together.
    some_and_all = (mesh.triangles[:_CHECKED_FIRST], mesh.triangles)
    if not any((Mesh(mesh.vertices, each).areas() > 0).any() for each in some_and_all):
        raise InputError(f"{source}: every face of the mesh has zero area")
