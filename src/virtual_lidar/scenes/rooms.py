from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from pointkit.errors import InputError, among
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from pointkit.yaml_files import read_yaml
from virtual_lidar.scenes.bodies import build_mesh
from virtual_lidar.scenes.furnishing import Maker, Placement, Room, lamp_grid
from virtual_lidar.scenes.furniture import fixtures, groups, seating, small, storage, tables
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.shell import Opening, window

_TABLES = read_yaml(Path(__file__).with_suffix(".yaml"))
AREAS: dict[str, dict[str, int]] = _TABLES["areas"]
"""Numbers of rooms of each type, by area of the building."""
ROOM_CHOICES: dict[str, list[str]] = _TABLES["room_choices"]
"""Names of rooms in `ROOMS` that are stretched to make rooms of each type."""

SENSOR_HEIGHT = 1.3
MAX_STRETCH = 1.35
_RIGID = {"auditorium_1"}  # its seats stand on steps of a fixed depth

_MODULES = {
    "groups": groups, "fixtures": fixtures, "seating": seating, "small": small,
    "storage": storage, "tables": tables,
}  # fmt: skip
_OPENINGS: dict[str, Callable[..., Opening]] = {
    "door": Opening,
    "passage": partial(Opening, kind="passage"),
    "window": window,
}


@dataclass(frozen=True)
class RoomSpec:
    """Specification of a room, as the file rooms.yaml states it, in metres.

    Parameters
    ----------
    kind
        Type of the room, such as "office".
    outline
        Corners of the floor, counter-clockwise.
    height
        Height of the ceiling.
    origin
        Position of a sensor, around which the floor stays free.
    openings
        Doors and windows.
    furnishing
        Items to place, in this order. Items for which there is no space are left out.
    lamps
        Function that makes a lamp, and the distance between lamps.
    """

    kind: str
    outline: tuple[tuple[float, float], ...]
    height: float
    origin: tuple[float, float]
    openings: tuple[Opening, ...]
    furnishing: tuple[Placement, ...]
    lamps: tuple[Maker, float]


def make_room(name: str, seed: int, detail: float = 1.0) -> Mesh:
    """Generate a furnished room as a labelled mesh.

    Parameters
    ----------
    name
        One of `ROOMS`, such as ``office_1``, or one of `room_types`, such as ``Area_1_office_1``.
    seed
        Seed of all random choices; the same name and seed give the same room.
    detail
        Factor by which curved parts have more segments than by default.

    Returns
    -------
    Mesh
        The room in metres, with z up, the floor at z = 0 and surfaces that face inwards. Labels
        name the object of each triangle, the semantic class of this object (such as "chair"), and
        the geometric primitive on which the triangle lies (such as "cylinder").

    Raises
    ------
    InputError
        There is no such room.
    """
    spec = room_spec(name, seed)
    cad = Modeller(generator(seed, "room", name), detail)
    outline = np.array(spec.outline)
    room = Room(cad, outline, spec.height, spec.openings, spec.origin)
    for placement in (*spec.furnishing, *lamp_grid(outline, *spec.lamps)):
        room.put(placement)
    return build_mesh(room.item)


def room_origin(name: str, seed: int = 0) -> tuple[float, float, float]:
    """Return a position for a sensor in a room of `make_room`, (x, y, z), m.

    The position is 1.3 m above the floor, and displaced at random by up to 5 cm from
    `RoomSpec.origin`.
    """
    spec = room_spec(name, seed)
    x, y = np.array(spec.origin) + generator(seed, "origin", name).uniform(-0.05, 0.05, 2)
    return (float(x), float(y), SENSOR_HEIGHT)


def room_box(name: str, seed: int = 0) -> Floats:
    """Return the lowest and highest corner of a room of `make_room`, (2, 3), m.

    Doors, windows and the spaces behind open doors may extend beyond this box.
    """
    spec = room_spec(name, seed)
    outline = np.array(spec.outline)
    return np.array([[*outline.min(axis=0), 0.0], [*outline.max(axis=0), spec.height]])


def room_spec(name: str, seed: int = 0) -> RoomSpec:
    """Return the specification of a room of `make_room`; raise InputError for other names."""
    if name in room_types():
        return building_room(name, seed)
    if name not in ROOMS:
        raise InputError(f"unknown room {name!r}{among(name, ROOMS)}")
    return ROOMS[name]


@cache
def room_types() -> dict[str, str]:
    """Return the type ("office") of each generated room, by name ("Area_1_office_1")."""
    return {
        f"{area}_{kind}_{number}": kind
        for area, counts in AREAS.items()
        for kind, count in counts.items()
        for number in range(1, count + 1)
    }


def building_room(name: str, seed: int) -> RoomSpec:
    """Return the specification of a generated room: a room of `ROOMS`, stretched at random."""
    kind = room_types()[name]
    rng = generator(seed, "building", name)
    base = str(rng.choice(ROOM_CHOICES[kind]))
    x, y = (1.0, 1.0) if base in _RIGID else rng.uniform(1.0, MAX_STRETCH, 2).tolist()
    return replace(stretched(ROOMS[base], x, y), kind=kind)


def stretched(spec: RoomSpec, x: float, y: float) -> RoomSpec:
    """Return a room that is longer by the factor `x` and wider by the factor `y`.

    The furniture keeps its size.
    """
    return replace(
        spec,
        outline=tuple((x * a, y * b) for a, b in spec.outline),
        origin=(x * spec.origin[0], y * spec.origin[1]),
        furnishing=tuple(_moved(placement, x, y) for placement in spec.furnishing),
    )


def _moved(placement: Placement, x: float, y: float) -> Placement:
    if placement.at is None or placement.where in ("wall", "mounted"):  # shares of a wall
        return placement
    place = (x * placement.at[0], y * placement.at[1], *placement.at[2:])
    return replace(placement, at=place, maker=_grown(placement, x, y))


def _grown(placement: Placement, x: float, y: float) -> Any:
    maker = placement.maker
    if not isinstance(maker, partial) or placement.where == "floor":
        return maker
    keywords = dict(maker.keywords)
    if "length" in keywords:
        keywords["length"] *= x
    if "points" in keywords:
        keywords["points"] = tuple((x * a, y * b, c) for a, b, c in keywords["points"])
    return partial(maker.func, *maker.args, **keywords)


def _room(
    *,
    outline: Sequence[tuple[float, float]],
    openings: Sequence[Mapping[str, Any]],
    furnishing: Sequence[Mapping[str, Any]],
    lamps: Mapping[str, float],
    **others: Any,
) -> RoomSpec:
    ((lamp, spacing),) = lamps.items()
    return RoomSpec(
        outline=tuple((x, y) for x, y in outline),
        openings=tuple(_OPENINGS[kind](**each[kind]) for each in openings for kind in each),
        furnishing=tuple(placement for each in furnishing for placement in _placements(**each)),
        lamps=(_maker(lamp), spacing),
        **others,
    )


def _placements(
    *,
    make: Sequence[str | Mapping[str, Any]],
    at: Sequence[tuple[float, ...] | None] = (None,),
    **others: Any,
) -> Iterator[Placement]:
    for maker in map(_maker, make):
        yield from (Placement(maker, at=place, **others) for place in at)


def _maker(entry: str | Mapping[str, Any]) -> Maker:
    name, options = (entry, {}) if isinstance(entry, str) else next(iter(entry.items()))
    module, _, function = name.partition(".")
    maker: Maker = getattr(_MODULES[module], function)
    return partial(maker, **options) if options else maker


ROOMS: dict[str, RoomSpec] = {name: _room(**entry) for name, entry in _TABLES["rooms"].items()}
"""Specifications of rooms by name, such as ``office_1``."""
