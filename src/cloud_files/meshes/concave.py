from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats, Ints

_TOLERANCE = 1e-6
"""Share of a fan's area that counts as rounding error."""


def concave_faces(vertices: Floats, triangles: Ints, face: Ints, faces: int) -> Ints:
    """Return the sorted indices of faces that a triangle fan around the first corner does not tile.

    A fan tiles a face if all triangles have the polygon's orientation. `face` (t,), ascending, has
    the face index of each triangle in `triangles` (t, 3).
    """
    of_polygon = np.flatnonzero(np.bincount(face, minlength=faces)[face] > 1)
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


def clip_ears(points: Floats) -> Ints:
    """Triangulate a polygon with corners (n, 3) in space; return corner indices (t, 3).

    The corners need not be coplanar. A hole may be joined to the outline by an edge that occurs
    twice.
    """
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
