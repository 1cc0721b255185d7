from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from pointkit.seeding import generator
from pointkit.yaml_files import read_yaml
from virtual_lidar.scenes.placement import Placement
from virtual_lidar.scenes.room_catalogue import ROOMS, RoomSpec

_TABLES = read_yaml(Path(__file__).with_suffix(".yaml"))
AREAS: dict[str, dict[str, int]] = _TABLES["areas"]
ROOM_CHOICES: dict[str, list[str]] = _TABLES["room_choices"]

MAX_STRETCH = 1.35
_RIGID = {"auditorium_1"}  # its seats stand on steps of a fixed depth


@cache
def room_types() -> dict[str, str]:
    """Return the rooms' types ("office") by name ("Area_1_office_1")."""
    return {
        f"{area}_{kind}_{number}": kind
        for area, counts in AREAS.items()
        for kind, count in counts.items()
        for number in range(1, count + 1)
    }


def building_room(name: str, seed: int) -> RoomSpec:
    """Return the specification of a building's room, made by stretching a catalogue room."""
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
