from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pointkit.yaml_files import read_yaml
from virtual_lidar.scenes import furniture_groups
from virtual_lidar.scenes.furniture import fixtures, seating, small, storage, tables
from virtual_lidar.scenes.placement import Maker, Placement
from virtual_lidar.scenes.shell import Opening, window

_MODULES = {
    "groups": furniture_groups, "fixtures": fixtures, "seating": seating, "small": small,
    "storage": storage, "tables": tables,
}  # fmt: skip
_OPENINGS: dict[str, Callable[..., Opening]] = {
    "door": Opening,
    "passage": partial(Opening, kind="passage"),
    "window": window,
}


@dataclass(frozen=True)
class RoomSpec:
    """Specification of a room, in metres, as in room_catalogue.yaml."""

    kind: str
    outline: tuple[tuple[float, float], ...]
    height: float
    origin: tuple[float, float]
    openings: tuple[Opening, ...]
    furnishing: tuple[Placement, ...]
    lamps: tuple[Maker, float]


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


ROOMS: dict[str, RoomSpec] = {
    name: _room(**entry) for name, entry in read_yaml(Path(__file__).with_suffix(".yaml")).items()
}
