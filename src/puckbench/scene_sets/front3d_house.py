from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cloud_files.meshes import read_mesh_report
from cloud_files.meshes.reading import y_up_to_z_up
from pointkit.errors import InputError
from pointkit.files import read_json
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh, check_mesh
from puckbench.scene_sets.base import freeform_labels, numbered_objects

MeshArrays = tuple[Floats, NDArray[np.int64]]
"""Vertices (v, 3), y up, and triangles (t, 3)."""


class _Pose(NamedTuple):
    position: Floats
    quaternion: Floats
    scale: Floats

    def apply(self, points: Floats) -> Floats:
        """Transform points (n, 3) from the model's coordinates to those of the house, y up."""
        return np.asarray((points * self.scale) @ _rotation(self.quaternion).T + self.position)


class _PlacedItem(NamedTuple):
    semantic: str
    pose: _Pose
    model: str | None = None
    surface: MeshArrays | None = None


@dataclass(frozen=True)
class HouseRoom:
    """A room of a 3D-FRONT house with its surfaces and furniture, ready for `build_room`.

    `left_out` counts the items without a surface, by reason.
    """

    name: str
    kind: str
    items: tuple[_PlacedItem, ...]
    left_out: dict[str, int]

    def models(self, folder: Path) -> list[Path]:
        """Return the paths, in the folder of the models, of the furniture that the room needs."""
        ids = dict.fromkeys(item.model for item in self.items if item.model is not None)
        return [_model_file(folder, model) for model in ids]


def read_rooms(path: Path) -> list[HouseRoom]:
    """Read the rooms of a house from its JSON file, without rooms that have no items."""
    house = read_json(path)
    try:
        parts = {part["uid"]: part for part in house["mesh"]}
        furniture = {item["uid"]: item for item in house["furniture"]}
        rooms = [_room(room, parts, furniture) for room in house["scene"]["room"]]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: not a readable house of 3D-FRONT ({error!r})") from error
    return [room for room in rooms if room.items]


def build_room(
    room: HouseRoom, folder: Path, what: str
) -> tuple[Mesh, Floats | None, dict[str, int]]:
    """Build the mesh of a room from the surfaces of its house and from furniture models.

    Parameters
    ----------
    room
        The room.
    folder
        The folder of the furniture models.
    what
        Text with which the message of an InputError begins.

    Returns
    -------
    tuple
        The labelled mesh, in metres with z up; the box (2, 3) around the house's surfaces, or None
        without them; and the numbers of items without a surface, by reason.

    Raises
    ------
    InputError
        No item has a surface.
    """
    left_out = Counter(room.left_out)
    placed: list[tuple[_PlacedItem, Floats, NDArray[np.int64]]] = []
    for item in room.items:
        surface = item.surface
        if item.model is not None:
            surface = _read_model(_model_file(folder, item.model))
        if surface is None:
            left_out["model_missing"] += 1
        else:
            placed.append((item, y_up_to_z_up(item.pose.apply(surface[0])), surface[1]))
    if not placed:
        raise InputError(f"{what}: no item of the room has a surface")
    house_points = [points for item, points, _ in placed if item.model is None]
    box = None
    if house_points:
        box = np.stack([np.vstack(house_points).min(axis=0), np.vstack(house_points).max(axis=0)])
    mesh = _joined(placed)
    check_mesh(mesh, what)
    return mesh, box, dict(left_out)


def _room(room: Any, parts: dict[str, Any], furniture: dict[str, Any]) -> HouseRoom:
    left_out: Counter[str] = Counter()
    items = tuple(_items(room["children"], parts, furniture, left_out))
    return HouseRoom(str(room["instanceid"]), str(room["type"]), items, dict(left_out))


def _items(
    children: Any, parts: dict[str, Any], furniture: dict[str, Any], left_out: Counter[str]
) -> Iterator[_PlacedItem]:
    for child in children:
        ref, pose = child["ref"], _pose(child)
        item = furniture.get(ref)
        if ref in parts:
            yield _PlacedItem(str(parts[ref]["type"]), pose, surface=_mesh_surface(parts[ref]))
        elif item is None:
            left_out["unknown_ref"] += 1
        elif item.get("valid") is not True:
            left_out["furniture_not_valid"] += 1
        else:
            semantic = str(item.get("category") or item.get("title") or "furniture")
            yield _PlacedItem(semantic, pose, model=str(item["jid"]))


def _pose(child: Any) -> _Pose:
    position, turn, scale = (np.array(child[key], np.float64) for key in ("pos", "rot", "scale"))
    shapes = (position.shape, turn.shape, scale.shape)
    if shapes != ((3,), (4,), (3,)) or not np.isfinite([*position, *turn, *scale]).all():
        raise ValueError(f"pos, rot and scale of {child['ref']} are not 3, 4 and 3 numbers")
    if not turn.any():
        raise ValueError(f"the rotation of {child['ref']} is zero")
    return _Pose(position, turn, scale)


def _mesh_surface(part: Any) -> MeshArrays:
    vertices = np.array(part["xyz"], dtype=np.float64).reshape(-1, 3)
    return vertices, np.array(part["faces"], dtype=np.int64).reshape(-1, 3)


def _model_file(folder: Path, model: str) -> Path:
    return folder / model / "raw_model.obj"


@lru_cache(maxsize=64)
def _read_model(path: Path) -> MeshArrays | None:
    if not path.is_file():
        return None
    mesh, _ = read_mesh_report(path, up="z")  # left as it is: the whole room is turned
    return mesh.vertices, mesh.triangles


def _rotation(quaternion: Floats) -> Floats:
    x, y, z, w = (quaternion / np.linalg.norm(quaternion)).tolist()
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def _joined(placed: list[tuple[_PlacedItem, Floats, NDArray[np.int64]]]) -> Mesh:
    starts = np.cumsum([0, *(len(points) for _, points, _ in placed)])
    triangles = [faces + start for (_, _, faces), start in zip(placed, starts, strict=False)]
    sizes = [len(faces) for _, _, faces in placed]
    owner = np.repeat(np.arange(len(placed), dtype=np.int32), sizes)
    objects = numbered_objects(item.semantic for item, _, _ in placed)
    labels = freeform_labels(owner, objects)
    return Mesh(np.vstack([points for _, points, _ in placed]), np.concatenate(triangles), labels)
