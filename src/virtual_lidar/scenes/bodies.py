from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pointkit.geometry.cloud import Floats, Ints
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject
from virtual_lidar.scenes.surfaces import Shape, Surface, join, pose, primitive


@dataclass(frozen=True)
class Body:
    """An object, or a part of an object, that has its own name in a scene.

    Parameters
    ----------
    kind
        What the body is (such as "mug"). Names of objects consist of the kind and a number.
    semantic
        Semantic class (such as "clutter").
    surface
        Surface of the body in its own coordinates.
    pose
        Similarity transform from these coordinates to the scene, (4, 4).
    """

    kind: str
    semantic: str
    surface: Surface
    pose: Floats = field(default_factory=lambda: np.eye(4))

    def transformed(self, pose: Floats) -> Body:
        """Return the body after a further similarity transform, (4, 4)."""
        return replace(self, pose=pose @ self.pose)

    def placed(self) -> Surface:
        """Return the surface of the body in the scene, i.e. after the transform `pose`."""
        return self.surface.transformed(self.pose)


Item = list[Body]
"""Bodies that are placed together, such as a desk and what stands on it."""


def posed(item: Iterable[Body], pose: Floats) -> Item:
    """Return an item after a similarity transform, (4, 4), of all its bodies."""
    return [body.transformed(pose) for body in item]


def moved(
    item: Iterable[Body], x: float = 0.0, y: float = 0.0, z: float = 0.0, **angles: float
) -> Item:
    """Return an item after the transform that the function `pose` makes from the same arguments."""
    return posed(item, pose(x, y, z, **angles))


def item_bounds(item: Iterable[Body]) -> Floats:
    """Return the lowest and highest corner, (2, 3), of a box that contains an item."""
    corners = np.concatenate([_box_corners(body) for body in item])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def _box_corners(body: Body) -> Floats:
    box = body.surface.bounds()
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(corners @ body.pose[:3, :3].T + body.pose[:3, 3])


def build_mesh(bodies: Sequence[Body]) -> Mesh:
    """Merge bodies into one mesh with a label for each triangle.

    Each body becomes an object, named by its kind and a number (such as "chair_3"). Each triangle
    is assigned to the geometric primitive of its surface; equal primitives are merged.
    """
    counts: Counter[str] = Counter()
    objects, shape_ids, object_ids = [], [], []
    primitives: list[Primitive] = []
    surfaces = [body.placed() for body in bodies]
    for number, (body, surface) in enumerate(zip(bodies, surfaces, strict=True)):
        counts[body.kind] += 1
        objects.append(SceneObject(f"{body.kind}_{counts[body.kind]}", body.semantic))
        index, distinct = _distinct(surface)
        shape_ids.append(index[surface.shape_id] + len(primitives))
        primitives += distinct
        object_ids.append(np.full(len(surface.triangles), number))
    whole = join(surfaces)
    labels = Labels(
        np.concatenate(object_ids).astype(np.int32),
        np.concatenate(shape_ids).astype(np.int32),
        tuple(objects),
        tuple(primitives),
    )
    return Mesh(whole.vertices, np.ascontiguousarray(whole.triangles), labels)


def _distinct(surface: Surface) -> tuple[Ints, list[Primitive]]:
    numbers: dict[tuple[Shape, bytes], int] = {}
    primitives: list[Primitive] = []
    index = np.empty(len(surface.shapes), dtype=np.int64)
    keys = _keys(surface)
    for number, (shape, frame) in enumerate(zip(surface.shapes, surface.frames, strict=True)):
        key = (shape, b"" if shape.kind == "freeform" else keys[shape.kind == "plane"][number])
        if key not in numbers:
            numbers[key] = len(primitives)
            primitives.append(primitive(shape, frame))
        index[number] = numbers[key]
    return index, primitives


def _keys(surface: Surface) -> tuple[list[bytes], list[bytes]]:
    frames = surface.frames
    normals = frames[:, :3, 2] / np.linalg.norm(frames[:, :3, 2], axis=1, keepdims=True)
    offsets = np.sum(normals * frames[:, :3, 3], axis=1, keepdims=True)
    planes = np.round(np.hstack([normals, offsets]), 7) + 0.0
    whole = np.round(frames, 7) + 0.0
    return [row.tobytes() for row in whole], [row.tobytes() for row in planes]
