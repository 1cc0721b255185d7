"""Triangles of concave polygons, by ear clipping on the plane that fits them best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

Integers = NDArray[np.int64]

_NOTHING = 1e-6
"""Share of a fan's area that is rounding: on the wrong side, or left over by parts that cancel."""


def fan_fails(vertices: Floats, triangles: Integers, face: Integers, faces: int) -> Integers:
    """Find the faces that their fan of triangles does not tile.

    A fan tiles its polygon where all its triangles run round the same way as the polygon.

    Parameters
    ----------
    vertices
        (v, 3).
    triangles, face
        The fans, (t, 3) indices of vertices, face after face, and the face of each, (t,).
    faces
        Number of faces.

    Returns
    -------
    Integers
        Faces, ascending; none that has vertices that are not finite.
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
        fails = np.minimum.reduceat(along, starts) < -_NOTHING * size * length
        fails |= length < _NOTHING * size
    return np.asarray(face[starts[fails]])


def clip_ears(points: Floats) -> Integers:
    """Cut a polygon into triangles that do not overlap.

    Parameters
    ----------
    points
        Its corners (n, 3), not necessarily on one plane; a hole may be joined to the outline by
        an edge that is passed twice.

    Returns
    -------
    Integers
        Triangles (t, 3) of indices of corners, which run round the same way as the polygon; none
        where the polygon has no area.

    References
    ----------
    The normal is that of Newell: M. E. Newell, R. G. Newell and T. L. Sancha, A solution to the
    hidden surface problem, ACM 1972. Ears are clipped by mapbox-earcut.
    """
    from mapbox_earcut import triangulate_float64

    flat = _on_best_plane(points)
    rings = np.array([len(flat)], dtype=np.uint32)
    return np.asarray(triangulate_float64(flat, rings).astype(np.int64).reshape(-1, 3))


def _on_best_plane(points: Floats) -> Floats:
    """Coordinates (n, 2) on the plane with the polygon's normal, counter-clockwise seen from it."""
    centred = points - points[0]
    areas = np.cross(centred[1:-1], centred[2:])
    normal, sizes = areas.sum(axis=0), np.linalg.norm(areas, axis=1)
    if np.linalg.norm(normal) < _NOTHING * sizes.sum():
        normal = areas[np.argmax(sizes)]  # its parts cancel each other
    normal = normal / np.linalg.norm(normal)
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    return np.ascontiguousarray(centred @ np.stack([u, np.cross(normal, u)], axis=1))
