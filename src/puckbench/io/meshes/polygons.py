"""Polygon meshes as files hold them, and their triangulation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Labels, Mesh
from puckbench.io.meshes.concave import clip_ears, fan_fails

Integers = NDArray[np.int64]

MOST_CORNERS = 5000
"""Of a concave face: the time of clipping ears may grow with the square."""


@dataclass(frozen=True)
class Polygons:
    """The polygons of a mesh file, before they are made into triangles.

    vertices: (v, 3) float64. corners: (sum of sizes,) int64 vertex indices, face after face.
    sizes: (f,) int64 corners per face. up: the axis the format prescribes, None where it does
    not say. labels: per face, only in files of our own. skipped: what the reader left out, by
    name, with its count. materials: names that the file gives to materials of faces.
    material_id: (f,) index into `materials`, -1 for none; None where the file names none.
    """

    vertices: Floats
    corners: Integers
    sizes: Integers
    up: str | None = None
    labels: Labels | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    materials: tuple[str, ...] = ()
    material_id: Integers | None = None


def uniform(vertices: Floats, faces: Integers) -> Polygons:
    """Polygons whose faces (f, k) all have k corners."""
    count, size = faces.shape
    return Polygons(vertices, faces.reshape(-1), np.full(count, size, dtype=np.int64))


def triangulate(polygons: Polygons, what: str) -> tuple[Mesh, Integers]:
    """Cut every face into a fan around its first corner, or, where that fails, into ears.

    Returns the mesh and, per triangle, the face it comes from (t,), ascending. Faces of fewer than
    three corners give no triangle. Raises InputError when a face refers to a missing vertex, or is
    concave and has more than `MOST_CORNERS` corners.
    """
    corners = polygons.corners
    if len(corners) and (corners.min() < 0 or corners.max() >= len(polygons.vertices)):
        raise InputError(f"{what}: a face refers to a vertex that does not exist")
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    fans = np.maximum(polygons.sizes - 2, 0)
    face = np.repeat(np.arange(len(fans)), fans)
    step = np.arange(len(face)) - np.repeat(np.cumsum(fans) - fans, fans)
    first = starts[face]
    triangles = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    concave = fan_fails(polygons.vertices, triangles, face, len(fans))
    if len(concave):
        _check_sizes(polygons.sizes, concave, what)
        triangles, face = _with_ears(polygons, starts, triangles, face, concave)
    return Mesh(polygons.vertices, triangles, _labels_of(polygons.labels, face)), face


def _check_sizes(sizes: Integers, concave: Integers, what: str) -> None:
    largest = concave[np.argmax(sizes[concave])]
    if sizes[largest] > MOST_CORNERS:
        fault = f"face {largest + 1} is concave and has {sizes[largest]} corners"
        raise InputError(f"{what}: {fault} (at most {MOST_CORNERS}): cut it into triangles")


def _with_ears(
    polygons: Polygons, starts: Integers, fans: Integers, face: Integers, concave: Integers
) -> tuple[Integers, Integers]:
    """Triangles, and the face of each, with ears in place of the fans of the concave faces."""
    parts, owners = [fans[~np.isin(face, concave)]], [face[~np.isin(face, concave)]]
    for number in concave.tolist():
        corners = polygons.corners[starts[number] :][: polygons.sizes[number]]
        ears = corners[clip_ears(polygons.vertices[corners])]
        parts.append(ears)
        owners.append(np.full(len(ears), number))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(parts)[order], owner[order]


def select_triangles(mesh: Mesh, rows: NDArray[np.bool_]) -> Mesh:
    """The mesh with only the triangles where `rows` (t,) is true, labels taken along."""
    labels = _labels_of(mesh.labels, np.flatnonzero(rows))
    return replace(mesh, triangles=mesh.triangles[rows], labels=labels)


def _labels_of(labels: Labels | None, face: Integers) -> Labels | None:
    if labels is None:
        return None
    return replace(labels, object_id=labels.object_id[face], primitive_id=labels.primitive_id[face])
