"""Faces of mesh files, which may have any number of corners, and their division into triangles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, Ints
from pointkit.geometry.mesh import Labels, Mesh

MAX_CORNERS = 5000
"""Maximum number of corners of a concave face: ear clipping takes quadratic time."""
_TOLERANCE = 1e-6
"""Share of a face's area that counts as rounding error."""


@dataclass(frozen=True)
class Polygons:
    """The content of a mesh file: faces with any number of corners.

    Functions that read one format return this object; `triangulate` makes a triangle mesh of it.

    Parameters
    ----------
    vertices
        Coordinates of the vertices, (v, 3), in the unit of the file.
    corners
        Row numbers in `vertices` of the corners of the first face, then of the second face, and so
        on, in one array.
    sizes
        Number of corners of each face, (f,).
    up
        Axis that points up, "y" or "z", if the file format defines it; otherwise None.
    labels
        Object and primitive of each face, for scenes that `write_mesh` wrote.
    skipped
        Numbers of elements that were left out because they are no faces, by kind.
    materials
        Names of the materials.
    material_id
        Index into `materials` for each face, (f,), -1 for a face without material; None if the file
        names no materials.
    """

    vertices: Floats
    corners: Ints
    sizes: Ints
    up: str | None = None
    labels: Labels | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    materials: tuple[str, ...] = ()
    material_id: Ints | None = None


def uniform_polygons(vertices: Floats, faces: Ints) -> Polygons:
    """Make polygons from faces that all have the same number of corners.

    Parameters
    ----------
    vertices
        Coordinates of the vertices, (v, 3).
    faces
        Row numbers in `vertices` of each face's corners, (f, corners).
    """
    count, size = faces.shape
    return Polygons(vertices, faces.reshape(-1), np.full(count, size, dtype=np.int64))


def triangulate(polygons: Polygons, source: str) -> tuple[Mesh, Ints]:
    """Divide faces into triangles that cover them exactly.

    A convex face becomes a fan of triangles around its first corner; a concave one is cut by ear
    clipping, so that no triangle lies outside of it. A face with a hole is one whose outline runs
    along an edge to the hole, and back along the same edge.

    Parameters
    ----------
    polygons
        The faces. Those of fewer than three corners have no triangles.
    source
        Name of the file, for the messages of errors.

    Returns
    -------
    tuple of Mesh and array
        The mesh with unchanged vertices; and the number of the face from which each triangle comes,
        (t,), in ascending order.

    Raises
    ------
    InputError
        A face refers to a vertex that does not exist, or a concave face has more than `MAX_CORNERS`
        corners.
    """
    corners = polygons.corners
    if len(corners) and (corners.min() < 0 or corners.max() >= len(polygons.vertices)):
        raise InputError(f"{source}: a face refers to a vertex that does not exist")
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    fans = np.maximum(polygons.sizes - 2, 0)
    face = np.repeat(np.arange(len(fans)), fans)
    step = np.arange(len(face)) - np.repeat(np.cumsum(fans) - fans, fans)
    first = starts[face]
    triangles = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    concave = _concave_faces(polygons.vertices, triangles, face)
    if len(concave):
        largest = concave[np.argmax(polygons.sizes[concave])]
        if (size := polygons.sizes[largest]) > MAX_CORNERS:
            fault = f"face {largest + 1} is concave and has {size} corners"
            raise InputError(f"{source}: {fault} (at most {MAX_CORNERS}): cut it into triangles")
        kept = ~np.isin(face, concave)
        parts, owners = [triangles[kept]], [face[kept]]
        for number in concave.tolist():
            outline = corners[starts[number] :][: polygons.sizes[number]]
            parts.append(outline[_clip_ears(polygons.vertices[outline])])
            owners.append(np.full(len(parts[-1]), number))
        owner = np.concatenate(owners)
        order = np.argsort(owner, kind="stable")
        triangles, face = np.concatenate(parts)[order], owner[order]
    return Mesh(polygons.vertices, triangles, _select_labels(polygons.labels, face)), face


def _concave_faces(vertices: Floats, triangles: Ints, face: Ints) -> Ints:
    """Return the sorted numbers of the faces whose fan has triangles of opposite orientations."""
    of_polygon = np.flatnonzero(np.bincount(face)[face] > 1)
    if not len(of_polygon):
        return of_polygon
    face = face[of_polygon]
    a, b, c = vertices[triangles[of_polygon]].swapaxes(0, 1)
    with np.errstate(invalid="ignore", over="ignore"):
        areas = np.cross(b - a, c - a)
        starts = np.flatnonzero(np.diff(face, prepend=-1))
        normal = np.add.reduceat(areas, starts)
        size = np.add.reduceat(np.linalg.norm(areas, axis=1), starts)
        length = np.linalg.norm(normal, axis=1)
        place = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(face)))
        along = np.einsum("ij,ij->i", areas, normal[place])
        fails = np.minimum.reduceat(along, starts) < -_TOLERANCE * size * length
        fails |= length < _TOLERANCE * size
    return np.asarray(face[starts[fails]])


def _clip_ears(points: Floats) -> Ints:
    """Return the triangles (t, 3) of a polygon as indices of its corners (n, 3)."""
    from mapbox_earcut import triangulate_float64

    flat = _on_best_plane(points)
    rings = np.array([len(flat)], dtype=np.uint32)
    return np.asarray(triangulate_float64(flat, rings).astype(np.int64).reshape(-1, 3))


def _on_best_plane(points: Floats) -> Floats:
    centred = points - points[0]
    areas = np.cross(centred[1:-1], centred[2:])
    normal, sizes = areas.sum(axis=0), np.linalg.norm(areas, axis=1)
    if np.linalg.norm(normal) < _TOLERANCE * sizes.sum():  # its triangles cancel out
        normal = areas[np.argmax(sizes)]
    normal = normal / np.linalg.norm(normal)
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    return np.ascontiguousarray(centred @ np.stack([u, np.cross(normal, u)], axis=1))


def select_triangles(mesh: Mesh, rows: NDArray[np.bool_]) -> Mesh:
    """Return a mesh with all vertices, but only the triangles in the mask `rows` (t,)."""
    labels = _select_labels(mesh.labels, np.flatnonzero(rows))
    return replace(mesh, triangles=mesh.triangles[rows], labels=labels)


def _select_labels(labels: Labels | None, face: Ints) -> Labels | None:
    if labels is None:
        return None
    return replace(labels, object_id=labels.object_id[face], primitive_id=labels.primitive_id[face])
