from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cloud_files.meshes.concave import clip_ears, concave_faces
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, Ints
from pointkit.geometry.mesh import Labels, Mesh

MAX_CORNERS = 5000
"""Maximum corners of a concave face: ear clipping takes quadratic time."""


@dataclass(frozen=True)
class Polygons:
    """Polygons of a mesh file.

    Parameters
    ----------
    corners
        Vertex indices of all faces, concatenated, (sum of sizes,).
    sizes
        Number of corners of each face, (f,).
    up
        The up axis, if the format defines it.
    skipped
        Number of skipped elements, by name.
    material_id
        Index into ``materials`` of each face, (f,), -1 for none.
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
    count, size = faces.shape
    return Polygons(vertices, faces.reshape(-1), np.full(count, size, dtype=np.int64))


def triangulate(polygons: Polygons, source: str) -> tuple[Mesh, Ints]:
    """Triangulate convex faces as fans around first corners, and concave faces by ear clipping.

    Returns the mesh and the face index of each triangle (t,), ascending. Raises InputError if a
    concave face has more than `MAX_CORNERS` corners.
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
    concave = concave_faces(polygons.vertices, triangles, face, len(fans))
    if len(concave):
        _check_sizes(polygons.sizes, concave, source)
        triangles, face = _with_ears(polygons, starts, triangles, face, concave)
    return Mesh(polygons.vertices, triangles, _select_labels(polygons.labels, face)), face


def _check_sizes(sizes: Ints, concave: Ints, source: str) -> None:
    largest = concave[np.argmax(sizes[concave])]
    if sizes[largest] > MAX_CORNERS:
        fault = f"face {largest + 1} is concave and has {sizes[largest]} corners"
        raise InputError(f"{source}: {fault} (at most {MAX_CORNERS}): cut it into triangles")


def _with_ears(
    polygons: Polygons, starts: Ints, fans: Ints, face: Ints, concave: Ints
) -> tuple[Ints, Ints]:
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
    labels = _select_labels(mesh.labels, np.flatnonzero(rows))
    return replace(mesh, triangles=mesh.triangles[rows], labels=labels)


def _select_labels(labels: Labels | None, face: Ints) -> Labels | None:
    if labels is None:
        return None
    return replace(labels, object_id=labels.object_id[face], primitive_id=labels.primitive_id[face])
