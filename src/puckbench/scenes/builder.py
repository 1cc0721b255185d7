"""Collecting the objects of a scene into one labelled mesh."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Labels, Mesh, Primitive, SceneObject
from puckbench.scenes.surfaces import Ints, Shape, Surface, freeform, join, primitive


@dataclass(frozen=True)
class Piece:
    """An object to be placed.

    Parameters
    ----------
    kind, semantic
        Such as "mug" and the semantic class "clutter".
    surface
        In its own frame.
    pose
        (4, 4) similarity from its frame to that of the item.
    """

    kind: str
    semantic: str
    surface: Surface
    pose: Floats = field(default_factory=lambda: np.eye(4))

    def moved(self, pose: Floats) -> Piece:
        """The piece under a similarity (4, 4)."""
        return replace(self, pose=pose @ self.pose)

    def placed(self) -> Surface:
        """The surface where the pose puts it."""
        return self.surface.moved(self.pose)


Item = list[Piece]
Furniture = Mapping[str, Sequence[Mesh]]


def moved(item: Iterable[Piece], pose: Floats) -> Item:
    """All pieces of an item under a similarity (4, 4)."""
    return [piece.moved(pose) for piece in item]


def bounds(item: Iterable[Piece]) -> Floats:
    """Corners of a box that holds all pieces, (2, 3)."""
    corners = np.concatenate([_box_corners(piece) for piece in item])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def _box_corners(piece: Piece) -> Floats:
    """The eight corners of the piece's own bounding box, where the pose puts them."""
    box = piece.surface.bounds()
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(corners @ piece.pose[:3, :3].T + piece.pose[:3, 3])


def refurnished(item: Item, furniture: Furniture, rng: np.random.Generator) -> Item:
    """Replace the pieces of an item by given meshes of the same semantic class.

    A mesh stands on the replaced piece's footprint and is stretched to its sizes, so that objects
    on a table stay on it; the content of a replaced bookcase is left out. Among the meshes of the
    class, one that needs little stretching is drawn.

    Parameters
    ----------
    item
        The pieces.
    furniture
        Meshes by semantic class, in metres, z up, with their front to -y.
    rng
        The stream that the choice is drawn from.
    """
    if item[0].semantic == "bookcase" and furniture.get("bookcase"):
        item = item[:1]
    return [
        _replaced(piece, furniture[piece.semantic], rng) if furniture.get(piece.semantic) else piece
        for piece in item
    ]


def _replaced(piece: Piece, meshes: Sequence[Mesh], rng: np.random.Generator) -> Piece:
    target = piece.surface.bounds()
    sizes = np.array([np.ptp(mesh.bounds(), axis=0) for mesh in meshes])
    factors = np.ptp(target, axis=0) / np.maximum(sizes, 1e-9)
    stretch = factors.max(axis=1) / factors.min(axis=1)
    fitting = np.flatnonzero(stretch <= max(1.5, float(stretch.min())))
    chosen = int(rng.choice(fitting))
    mesh = meshes[chosen]
    vertices = (mesh.vertices - mesh.bounds().mean(axis=0)) * factors[chosen] + target.mean(axis=0)
    return replace(piece, surface=freeform(vertices, mesh.triangles))


def build(pieces: Sequence[Piece]) -> Mesh:
    """The labelled mesh of pieces; objects are numbered by kind, in the order given.

    Equal primitives of one object are one primitive.
    """
    counts: Counter[str] = Counter()
    objects, shape_ids, object_ids = [], [], []
    primitives: list[Primitive] = []
    surfaces = [piece.placed() for piece in pieces]
    for number, (piece, surface) in enumerate(zip(pieces, surfaces, strict=True)):
        counts[piece.kind] += 1
        objects.append(SceneObject(f"{piece.kind}_{counts[piece.kind]}", piece.semantic))
        index, own = _distinct(surface)
        shape_ids.append(index[surface.shape_id] + len(primitives))
        primitives += own
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
    """The number of each shape's primitive, (s,), and the distinct primitives of a surface."""
    known: dict[tuple[Shape, bytes], int] = {}
    primitives: list[Primitive] = []
    index = np.empty(len(surface.shapes), dtype=np.int64)
    keys = _keys(surface)
    for number, (shape, frame) in enumerate(zip(surface.shapes, surface.frames, strict=True)):
        key = (shape, b"" if shape.kind == "freeform" else keys[shape.kind == "plane"][number])
        if key not in known:
            known[key] = len(primitives)
            primitives.append(primitive(shape, frame))
        index[number] = known[key]
    return index, primitives


def _keys(surface: Surface) -> tuple[list[bytes], list[bytes]]:
    """Keys of shapes beside their sizes: their frames, and for planes the normal and offset."""
    frames = surface.frames
    normals = frames[:, :3, 2] / np.linalg.norm(frames[:, :3, 2], axis=1, keepdims=True)
    offsets = np.sum(normals * frames[:, :3, 3], axis=1, keepdims=True)
    planes = np.round(np.hstack([normals, offsets]), 7) + 0.0
    whole = np.round(frames, 7) + 0.0
    return [one.tobytes() for one in whole], [one.tobytes() for one in planes]
