"""Triangle meshes with labelled triangles: the ground truth of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

_PLACES = ("point", "centre", "apex")
_LENGTHS = ("radius", "major_radius", "minor_radius", "sizes")
"""Parameters of primitives that are places, and those that are lengths."""


@dataclass(frozen=True)
class Primitive:
    """A geometric primitive that a surface lies on (thesis section 7).

    Parameters
    ----------
    kind
        "plane", "cylinder", "sphere", "cone", "torus", "superquadric" or "freeform".
    parameters
        Numbers in world coordinates (metres, radians) by name; directions are unit vectors. A plane
        has ``normal`` and ``offset`` (normal . p = offset), a cylinder ``point``, ``axis`` and
        ``radius``, a sphere ``centre`` and ``radius``, a cone ``apex``, ``axis`` (into the cone)
        and ``half_angle``, a torus ``centre``, ``axis``, ``major_radius`` and ``minor_radius``, a
        superquadric ``centre``, ``axes``, ``sizes`` and ``exponents``.
    """

    kind: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class SceneObject:
    """One object of a scene: its name (``"chair_3"``) and semantic class (``"chair"``)."""

    name: str
    semantic: str


@dataclass(frozen=True)
class Labels:
    """Ground truth of each triangle; its semantic class is that of its object.

    Parameters
    ----------
    object_id
        Index into `objects`, (t,) int32.
    primitive_id
        Index into `primitives`, (t,) int32.
    objects, primitives
        The objects and primitives of the scene.
    """

    object_id: NDArray[np.int32]
    primitive_id: NDArray[np.int32]
    objects: tuple[SceneObject, ...]
    primitives: tuple[Primitive, ...]


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with z up.

    Parameters
    ----------
    vertices
        (v, 3) float64, metres.
    triangles
        Indices of vertices, (t, 3) int64.
    labels
        Ground truth of the triangles, or None.
    """

    vertices: Floats
    triangles: NDArray[np.int64]
    labels: Labels | None = None

    def corners(self) -> Floats:
        """Triangle corners, (t, 3, 3)."""
        return self.vertices[self.triangles]

    def areas(self) -> Floats:
        """Triangle areas, (t,)."""
        return np.asarray(np.linalg.norm(self._doubled_areas(), axis=1) / 2)

    def normals(self) -> Floats:
        """Unit triangle normals, (t, 3); zero for triangles without area."""
        doubled = self._doubled_areas()
        lengths = np.linalg.norm(doubled, axis=1, keepdims=True)
        return np.asarray(
            np.divide(doubled, lengths, where=lengths > 0, out=np.zeros_like(doubled))
        )

    def bounds(self) -> Floats:
        """Corners of the axis-aligned bounding box of the triangles, (2, 3)."""
        used = self.vertices[np.unique(self.triangles)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    def _doubled_areas(self) -> Floats:
        a, b, c = self.corners().swapaxes(0, 1)
        return np.asarray(np.cross(b - a, c - a))


def in_metres(primitive: Primitive, scale: float, offset: Floats) -> Primitive:
    """Transform a primitive from a scaled frame to metres.

    Parameters
    ----------
    primitive
        In the scaled frame.
    scale
        Units of the scaled frame per metre.
    offset
        (3,), metres: points are transformed by ``metres = scaled / scale + offset``.
    """
    moved = dict(primitive.parameters)
    for name in _LENGTHS:
        if name in moved:
            moved[name] = (np.asarray(moved[name]) / scale).tolist()
    for name in _PLACES:
        if name in moved:
            moved[name] = (np.asarray(moved[name]) / scale + offset).tolist()
    if "normal" in moved:
        moved["offset"] = float(moved["offset"] / scale + np.dot(moved["normal"], offset))
    return Primitive(primitive.kind, moved)


def surface_in_metres(surface: Mesh, scale: float, offset: Floats) -> Mesh:
    """Transform a labelled mesh and its primitives from a scaled frame, as `in_metres` does."""
    vertices = surface.vertices / scale + offset
    if surface.labels is None:
        return replace(surface, vertices=vertices)
    placed = tuple(in_metres(one, scale, offset) for one in surface.labels.primitives)
    return replace(surface, vertices=vertices, labels=replace(surface.labels, primitives=placed))


def scaled_mesh(mesh: Mesh, metres_per_unit: float) -> Mesh:
    """Scale a mesh and its labelled primitives from another unit to metres."""
    labels = mesh.labels
    if labels is not None and metres_per_unit != 1:
        scale, origin = 1 / metres_per_unit, np.zeros(3)
        placed = tuple(in_metres(primitive, scale, origin) for primitive in labels.primitives)
        labels = replace(labels, primitives=placed)
    return Mesh(mesh.vertices * metres_per_unit, mesh.triangles, labels)


def check_mesh(mesh: Mesh, what: str) -> None:
    """Refuse a mesh without area, with vertices that are not finite, or with invalid indices.

    Raises
    ------
    InputError
        Begins with `what`, the name of the mesh's source.
    """
    if len(mesh.triangles) == 0:
        raise InputError(f"{what}: the mesh has no faces")
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
        raise InputError(f"{what}: a face refers to a vertex that does not exist")
    unplaced = np.asarray(~np.isfinite(mesh.vertices).all(axis=1))
    if unplaced.any() and unplaced[mesh.triangles].any():
        raise InputError(f"{what}: a face has a vertex that is not finite")
    if not _has_area(mesh):
        raise InputError(f"{what}: every face of the mesh has zero area")


def _has_area(mesh: Mesh) -> bool:
    """Whether any triangle has an area; stops at the first part of the mesh with one."""
    starts = range(0, len(mesh.triangles), 4096)
    some = (Mesh(mesh.vertices, mesh.triangles[start : start + 4096]) for start in starts)
    return any((part.areas() > 0).any() for part in some)
