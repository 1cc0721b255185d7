from __future__ import annotations

import numpy as np

from pointkit.errors import InputError, among
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from virtual_lidar.scenes.building import building_room, room_types
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.pieces import build_mesh
from virtual_lidar.scenes.placement import Room, lamp_grid
from virtual_lidar.scenes.room_catalogue import ROOMS, RoomSpec

SENSOR_HEIGHT = 1.3


def make_room(name: str, seed: int, detail: float = 1.0) -> Mesh:
    """Return the labelled mesh of a room in `room_catalogue.ROOMS` or `building.room_types`.

    `detail` multiplies the number of segments of curved parts.
    """
    spec = room_spec(name, seed)
    cad = Modeller(generator(seed, "room", name), detail)
    outline = np.array(spec.outline)
    room = Room(cad, outline, spec.height, spec.openings, spec.origin)
    for placement in (*spec.furnishing, *lamp_grid(outline, *spec.lamps)):
        room.put(placement)
    return build_mesh(room.item)


def origin(name: str, seed: int = 0) -> tuple[float, float, float]:
    """Return a sensor position, 1.3 m high, randomly displaced by up to 5 cm."""
    spec = room_spec(name, seed)
    x, y = np.array(spec.origin) + generator(seed, "origin", name).uniform(-0.05, 0.05, 2)
    return (float(x), float(y), SENSOR_HEIGHT)


def room_box(name: str, seed: int = 0) -> Floats:
    """Return the room's bounding box (2, 3), m, without recesses."""
    spec = room_spec(name, seed)
    outline = np.array(spec.outline)
    return np.array([[*outline.min(axis=0), 0.0], [*outline.max(axis=0), spec.height]])


def room_spec(name: str, seed: int = 0) -> RoomSpec:
    if name in room_types():
        return building_room(name, seed)
    if name not in ROOMS:
        raise InputError(f"unknown room {name!r}{among(name, ROOMS)}")
    return ROOMS[name]
