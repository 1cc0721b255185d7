"""Rooms captured by a virtual reality headset: a mesh, and detected planes and boxes."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.meshes.reading import y_up_to_z_up
from pointkit.errors import InputError
from pointkit.files import open_file, read_json
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Labels, Mesh, check_mesh
from puckbench.scene_sets.base import FolderSet, freeform_labels, numbered_objects
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, unique_names

Entity = Mapping[str, Any]

_SEMANTIC = {"couch": "sofa", "door_frame": "door", "wall_face": "wall", "window_frame": "window"}
# How far a measured surface may lie from the entity that it is taken for.
_NEAR_M, _FAR_M = 0.05, 0.15
_PARALLEL = 0.7


@LOADERS.register("captured_rooms")
class CapturedRooms(FolderSet):
    """The scenes are rooms captured by a headset, in JSON files (five in npm package @iwer/sem).

    Meshes are in metres, rotated to z up. A triangle gets the first of these labels that exists:
    that of the smallest parallel plane patch (wall, door, ...) within 5 cm; that of the smallest
    box (table, sofa, ...) around it; that of the smallest parallel patch within 15 cm; "clutter".
    All primitives are "freeform".
    """

    licence = "MIT"
    credit = "Meta Platforms, npm package @iwer/sem"
    expected = "expected captured rooms (.json)"

    def load(self, name: str) -> Scene:
        return read_capture(self.file_of(name), name)

    def listed(self, folder: Path) -> Mapping[str, Path]:
        paths = sorted(path for path in folder.glob("*.json") if is_captured_room(path))
        if not paths:
            raise self.missing("captured rooms (.json with spatialEntities)")
        return dict(sorted(zip(unique_names(path.stem for path in paths), paths, strict=True)))


def read_capture(path: Path, name: str | None = None) -> Scene:
    """Read a captured room from a JSON file.

    Parameters
    ----------
    path
        The file.
    name
        Name of the scene; by default that of the file.

    Returns
    -------
    Scene
        The room as a labelled mesh, in metres with z up.

    Raises
    ------
    InputError
        The file is not a captured room, or it is damaged.
    """
    entities = _entities(path)
    try:
        mesh = _room_mesh(entities, path)
        placed = _placed_entities(entities)
    except (KeyError, TypeError, ValueError, binascii.Error) as error:
        raise InputError(f"{path}: not a readable captured room ({error!r})") from error
    check_mesh(mesh, str(path))
    labels = _labels(mesh, placed)
    turned = Mesh(y_up_to_z_up(mesh.vertices), mesh.triangles, labels)
    about = {
        "source": path.name,
        "licence": CapturedRooms.licence,
        "credit": CapturedRooms.credit,
        "triangles": len(mesh.triangles),
        "clutter": int(np.count_nonzero(labels.object_id == len(placed))),
    }
    return Scene(name or path.stem, "captured_room", mesh=turned, about=about)


@dataclass(frozen=True)
class _PlacedEntity:
    """A plane patch or a box that the headset detected, with rotation, position and extent."""

    semantic: str
    rotation: Floats
    position: Floats
    low: Floats
    high: Floats
    flat: bool

    def size(self) -> float:
        extent = self.high - self.low
        return float(np.prod(extent[[0, 2]] if self.flat else extent))

    def holds(self, points: Floats, normals: Floats, reach: float) -> NDArray[np.bool_]:
        local = (points - self.position) @ self.rotation
        inside = ((local >= self.low - reach) & (local <= self.high + reach)).all(axis=1)
        if self.flat:
            inside &= np.abs(normals @ self.rotation[:, 1]) > _PARALLEL
        return np.asarray(inside)


def is_captured_room(path: Path) -> bool:
    try:
        with open_file(path) as stream:
            return b'"spatialEntities"' in stream.read(1 << 16)
    except InputError:
        return False


def _entities(path: Path) -> list[Entity]:
    content = read_json(path)
    entities = content.get("spatialEntities") if isinstance(content, dict) else None
    if not isinstance(entities, list):
        raise InputError(f"{path}: not a captured room (no spatialEntities)")
    return entities


def _room_mesh(entities: list[Entity], path: Path) -> Mesh:
    holders = [entity for entity in entities if "triangleMesh_META" in entity]
    if not holders:
        raise InputError(f"{path}: the captured room has no mesh")
    entity = max(holders, key=lambda holder: len(holder["triangleMesh_META"]["indices"]))
    mesh = entity["triangleMesh_META"]
    local = np.frombuffer(base64.b64decode(mesh["vertices"]), dtype="<f4").reshape(-1, 3)
    triangles = np.frombuffer(base64.b64decode(mesh["indices"]), dtype="<u4").reshape(-1, 3)
    rotation, position = _frame(entity)
    return Mesh(local.astype(np.float64) @ rotation.T + position, triangles.astype(np.int64))


def _placed_entities(entities: list[Entity]) -> list[_PlacedEntity]:
    boxes = [_box(entity) for entity in entities if "bounded3D_META" in entity]
    boxed = {box.semantic for box in boxes}
    flats = [_patch(entity) for entity in entities if "bounded2D_META" in entity]
    return boxes + [flat for flat in flats if flat.semantic not in boxed]


def _box(entity: Entity) -> _PlacedEntity:
    bounds = entity["bounded3D_META"]
    low = np.array([bounds["offset"][axis] for axis in "xyz"])
    extent = np.array([bounds["extent"][side] for side in ("width", "height", "depth")])
    return _PlacedEntity(_semantic(entity), *_frame(entity), low, low + extent, flat=False)


def _patch(entity: Entity) -> _PlacedEntity:
    offset, extent = entity["bounded2D_META"]["offset"], entity["bounded2D_META"]["extent"]
    # The patch is given in its own x, y plane, which is the x, -z plane of the entity's frame.
    low = np.array([offset["x"], 0.0, -offset["y"] - extent["height"]])
    high = np.array([offset["x"] + extent["width"], 0.0, -offset["y"]])
    return _PlacedEntity(_semantic(entity), *_frame(entity), low, high, flat=True)


def _semantic(entity: Entity) -> str:
    name = str(entity["semanticLabel_META"]).lower()
    return _SEMANTIC.get(name, name)


def _frame(entity: Entity) -> tuple[Floats, Floats]:
    place = entity["locatable_META"]
    x, y, z, w = (float(place["orientation"][axis]) for axis in "xyzw")
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return rotation, np.array([float(place["position"][axis]) for axis in "xyz"])


def _labels(mesh: Mesh, placed: list[_PlacedEntity]) -> Labels:
    points, normals = mesh.corners().mean(axis=1), mesh.normals()
    clutter = len(placed)
    owner = np.full(len(points), clutter, dtype=np.int32)
    by_size = sorted(range(clutter), key=lambda index: placed[index].size())
    for flat, reach in ((True, _NEAR_M), (False, _NEAR_M), (True, _FAR_M)):
        for index in (index for index in by_size if placed[index].flat == flat):
            free = owner == clutter
            owner[free & placed[index].holds(points, normals, reach)] = index
    classes = [item.semantic for item in placed] + ["clutter"]
    return freeform_labels(owner, numbered_objects(classes))
