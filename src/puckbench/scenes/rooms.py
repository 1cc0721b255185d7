"""Furnished rooms by name: their meshes, their boxes and where a sensor may stand."""

from __future__ import annotations

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.models import among
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.scenes.builder import Furniture, build
from puckbench.scenes.building import building_room, room_types
from puckbench.scenes.modeller import Modeller
from puckbench.scenes.placing import Maker, Room, lamp_grid
from puckbench.scenes.room_table import ROOMS, RoomSpec

SENSOR_HEIGHT = 1.3


def make_room(
    name: str, seed: int, detail: float = 1.0, furniture: Furniture | None = None
) -> Mesh:
    """The labelled mesh of a furnished room.

    Parameters
    ----------
    name
        A room of the table (`room_table.ROOMS`) or of the building (`building.room_types`).
    seed
        Seed of the furnishing.
    detail
        Factor on the number of segments around curved parts.
    furniture
        By semantic class ("chair"), meshes in metres, z up, front to -y, that replace the generated
        pieces of that class.

    Raises
    ------
    InputError
        The name is unknown.
    """
    spec = room_spec(name, seed)
    cad = Modeller(generator(seed, "room", name), detail)
    outline = np.array(spec.outline)
    room = Room(cad, outline, spec.height, spec.openings, spec.origin, furniture or {})
    for placement in (*spec.furnishing, *lamp_grid(*_lamps(spec, outline))):
        room.put(placement)
    return build(room.item)


def origin(name: str, seed: int = 0) -> tuple[float, float, float]:
    """Where a sensor may stand in a room: 1.3 m up, moved by up to 5 cm by the seed."""
    spec = room_spec(name, seed)
    x, y = np.array(spec.origin) + generator(seed, "origin", name).uniform(-0.05, 0.05, 2)
    return (float(x), float(y), SENSOR_HEIGHT)


def room_box(name: str, seed: int = 0) -> Floats:
    """The room's box (2, 3) between its walls, floor and ceiling, without recesses."""
    spec = room_spec(name, seed)
    outline = np.array(spec.outline)
    return np.array([[*outline.min(axis=0), 0.0], [*outline.max(axis=0), spec.height]])


def room_spec(name: str, seed: int = 0) -> RoomSpec:
    """The shape of a room; those of the building depend on the seed. InputError: unknown name."""
    if name in room_types():
        return building_room(name, seed)
    if name not in ROOMS:
        raise InputError(f"unknown room {name!r}{among(name, ROOMS)}")
    return ROOMS[name]


def _lamps(spec: RoomSpec, outline: Floats) -> tuple[Maker, Floats, float, float]:
    maker, spacing = spec.lamps
    x, y = np.ptp(outline, axis=0)
    return maker, outline, spacing, 90.0 if y > x else 0.0
