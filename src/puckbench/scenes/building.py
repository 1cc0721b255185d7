from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

from puckbench.core.seeding import generator
from puckbench.scenes.placement import Placement
from puckbench.scenes.room_catalogue import ROOMS, RoomSpec

AREAS: dict[str, dict[str, int]] = {
    "Area_1": {
        "WC": 1, "conferenceRoom": 2, "copyRoom": 1, "hallway": 8, "office": 31, "pantry": 1,
    },
    "Area_2": {
        "WC": 2, "auditorium": 2, "conferenceRoom": 1, "hallway": 12, "office": 14, "storage": 9,
    },
    "Area_3": {
        "WC": 2, "conferenceRoom": 1, "hallway": 6, "lounge": 2, "office": 10, "storage": 2,
    },
    "Area_4": {
        "WC": 4, "conferenceRoom": 3, "hallway": 14, "lobby": 2, "office": 22, "storage": 4,
    },
    "Area_5": {
        "WC": 2, "conferenceRoom": 3, "hallway": 15, "lobby": 1, "office": 42, "pantry": 1,
        "storage": 4,
    },
    "Area_6": {
        "conferenceRoom": 1, "copyRoom": 1, "hallway": 6, "lounge": 1, "office": 37,
        "openspace": 1, "pantry": 1,
    },
}  # fmt: skip
"""Rooms of each type in the areas of S3DIS v1.2: 44, 40, 23, 49, 68 and 48, 272 in all."""

ROOM_CHOICES = {
    "WC": ("pantry_1", "copy_room_1"),  # small rooms with fittings along the walls
    "auditorium": ("auditorium_1",),
    "conferenceRoom": ("conference_room_1", "meeting_room_1"),
    "copyRoom": ("copy_room_1",),
    "hallway": ("hallway_1", "hallway_2", "hallway_3"),
    "lobby": ("lounge_1", "gallery_1"),
    "lounge": ("lounge_1",),
    "office": ("office_1", "office_2", "office_3", "office_4"),
    "openspace": ("office_3",),
    "pantry": ("pantry_1",),
    "storage": ("storage_1", "storage_2"),
}
"""Rooms of the catalogue for each type of S3DIS; one of them is drawn."""

MAX_STRETCH = 1.35
_RIGID = {"auditorium_1"}  # its seats stand on steps of a fixed depth


@cache
def room_types() -> dict[str, str]:
    """Return the type of each room ("office") by its name ("Area_1_office_1")."""
    return {
        f"{area}_{kind}_{number}": kind
        for area, counts in AREAS.items()
        for kind, count in counts.items()
        for number in range(1, count + 1)
    }


def building_room(name: str, seed: int) -> RoomSpec:
    """Return the specification of a room of the building: a stretched room of the catalogue."""
    kind = room_types()[name]
    rng = generator(seed, "building", name)
    base = str(rng.choice(ROOM_CHOICES[kind]))
    x, y = (1.0, 1.0) if base in _RIGID else rng.uniform(1.0, MAX_STRETCH, 2).tolist()
    return replace(stretched(ROOMS[base], x, y), kind=kind)


def stretched(spec: RoomSpec, x: float, y: float) -> RoomSpec:
    return replace(
        spec,
        outline=tuple((x * a, y * b) for a, b in spec.outline),
        origin=(x * spec.origin[0], y * spec.origin[1]),
        furnishing=tuple(_moved(placement, x, y) for placement in spec.furnishing),
    )


def _moved(placement: Placement, x: float, y: float) -> Placement:
    if placement.at is None or placement.where in (
        "wall",
        "mounted",
    ):  # places are shares of a wall
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
