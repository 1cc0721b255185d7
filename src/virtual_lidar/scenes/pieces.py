from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pointkit.geometry.cloud import Floats, Ints
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject
from virtual_lidar.scenes.surfaces import Shape, Surface, join, pose, primitive


@dataclass(frozen=True)
class Piece:
    """An object or a part: kind ("mug"), semantic class ("clutter"), surface and pose (4, 4)."""

    kind: str
    semantic: str
    surface: Surface
    pose: Floats = field(default_factory=lambda: np.eye(4))

    def transformed(self, pose: Floats) -> Piece:
        return replace(self, pose=pose @ self.pose)

    def placed(self) -> Surface:
        return self.surface.transformed(self.pose)


Item = list[Piece]


def posed(item: Iterable[Piece], pose: Floats) -> Item:
    """Transform all pieces of an item by a similarity transform (4, 4)."""
    return [piece.transformed(pose) for piece in item]


def moved(
    item: Iterable[Piece], x: float = 0.0, y: float = 0.0, z: float = 0.0, **angles: float
) -> Item:
    """Move an item by the transform that `pose` returns."""
    return posed(item, pose(x, y, z, **angles))


def item_bounds(item: Iterable[Piece]) -> Floats:
    corners = np.concatenate([_box_corners(piece) for piece in item])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def _box_corners(piece: Piece) -> Floats:
    box = piece.surface.bounds()
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(corners @ piece.pose[:3, :3].T + piece.pose[:3, 3])


def build_mesh(pieces: Sequence[Piece]) -> Mesh:
    """Merge pieces into a labelled mesh; objects are named by kind and number ("chair_3").

    Equal primitives of an object are merged.
    """
    counts: Counter[str] = Counter()
    objects, shape_ids, object_ids = [], [], []
    primitives: list[Primitive] = []
    surfaces = [piece.placed() for piece in pieces]
    for number, (piece, surface) in enumerate(zip(pieces, surfaces, strict=True)):
        counts[piece.kind] += 1
        objects.append(SceneObject(f"{piece.kind}_{counts[piece.kind]}", piece.semantic))
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
