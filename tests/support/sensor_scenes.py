"""Small scenes for the sensor's tests, built by hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject

ROOM = np.array([6.0, 5.0, 3.0])
FACES = ("-x", "+x", "-y", "+y", "-z", "+z")


def quad(corner: ArrayLike, along: ArrayLike, across: ArrayLike) -> Mesh:
    corner, along, across = (np.asarray(vector, dtype=float) for vector in (corner, along, across))
    vertices = np.array([corner, corner + along, corner + along + across, corner + across])
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))


def joined(meshes: list[Mesh], labels: Labels | None = None) -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(triangles), labels)


def box(low: ArrayLike, size: ArrayLike, skip: tuple[str, ...] = ()) -> Mesh:
    """A box, face by face in the order of `FACES`; each face is its own object and primitive."""
    low, size = np.asarray(low, dtype=float), np.asarray(size, dtype=float)
    faces, kept = [], [name for name in FACES if name not in skip]
    for name in kept:
        axis = "xyz".index(name[1])
        along, across = np.delete(np.eye(3), axis, axis=0) * size
        faces.append(quad(low + (np.eye(3)[axis] * size if name[0] == "+" else 0), along, across))
    ids = np.repeat(np.arange(len(kept), dtype=np.int32), 2)
    objects = tuple(SceneObject(name, "wall") for name in kept)
    primitives = tuple(Primitive("plane", {}) for _ in kept)
    return joined(faces, Labels(ids, ids + np.int32(10), objects, primitives))


def room(skip: tuple[str, ...] = ()) -> Mesh:
    return box([0, 0, 0], ROOM, skip)


def moved(mesh: Mesh, by: ArrayLike) -> Mesh:
    return Mesh(mesh.vertices + np.asarray(by), mesh.triangles, mesh.labels)


def wall(distance: float, half: float = 3000.0) -> Mesh:
    """A wall at y = distance, seen by a sensor at the origin."""
    return quad([-half, distance, -half], [2 * half, 0, 0], [0, 0, 2 * half])


def floor(below: float, half: float = 3000.0) -> Mesh:
    """A floor at z = -below, seen by a sensor at the origin."""
    return quad([-half, -half, -below], [2 * half, 0, 0], [0, 2 * half, 0])
