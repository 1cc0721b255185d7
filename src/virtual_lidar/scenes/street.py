from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from virtual_lidar.scenes import street_objects
from virtual_lidar.scenes.bodies import Body, Item, build_mesh, posed
from virtual_lidar.scenes.furnishing import FloorPlan, footprint, occupy_if_free
from virtual_lidar.scenes.houses import MAX_WIDTH, MIN_WIDTH, house
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outdoors import car
from virtual_lidar.scenes.street_ground import (
    CROSS_STREET,
    END_DEPTH,
    END_PAVEMENT,
    HALF_WIDTH,
    LANE,
    PARKING,
    PAVEMENT_Z,
    PROPERTY_Y,
    ROAD,
    ground,
    road_height,
)
from virtual_lidar.scenes.surfaces import join, pose

SENSOR_HEIGHT = 1.9
Maker = Callable[[Modeller], Item]

# Segments of curved parts: coarser than those of furniture, which is seen from nearer.
_DETAIL, _UNIT = 0.7, 0.1
_KERBSIDE = ROAD + 0.75
_CLEAR_HEIGHT = 4.0


def make_street(name: str, seed: int, length: float) -> Mesh:
    """Generate a street with houses, parked cars, trees and street furniture as a labelled mesh.

    Parameters
    ----------
    name, seed
        Any text and any number, which seed all random choices; equal ones give the same street.
    length
        Distance between the two cross streets at the ends, m.

    Returns
    -------
    Mesh
        The street in metres, with z up. It runs along x and is centred on the origin. Labels name
        the object of each triangle, the semantic class of this object (such as "car"), and the
        geometric primitive on which the triangle lies (such as "cylinder").
    """
    street = _Street(
        length, lambda part: Modeller(generator(seed, "street", name, part), _DETAIL, _UNIT)
    )
    street.add(ground(street.cad("ground"), length))
    for part in (_houses, _ends, _street_furniture, _trees, _cars):
        part(street)
    return build_mesh(street.item)


def street_origin() -> tuple[float, float, float]:
    """Return a position for a sensor halfway along the street, (x, y, z), m.

    The position is 1.9 m above the lane for traffic towards +x.
    """
    return (0.0, -LANE / 2, SENSOR_HEIGHT + road_height(LANE / 2))


def free_way(length: float) -> tuple[float, float]:
    """Return the first and the last x, m, of a free path along the street, 1 m from any object."""
    return (-length / 2, length / 2)


@dataclass
class _Street:
    length: float
    cad: Callable[[str], Modeller]
    item: Item = field(default_factory=list)
    plan: FloorPlan = field(init=False)

    def __post_init__(self) -> None:
        x = self.length / 2 + CROSS_STREET + END_DEPTH
        self.plan = FloorPlan(footprint((-x, -HALF_WIDTH), (x, HALF_WIDTH), np.eye(4)))
        lanes = footprint((-x, 0.5 - LANE), (x, LANE - 0.5), np.eye(4))
        self.plan.occupy(lanes, 0.0, _CLEAR_HEIGHT)

    def add(self, item: Item, place: Floats | None = None) -> None:
        self.item += item if place is None else posed(item, place)

    def put(self, item: Item, place: Floats) -> None:
        if occupy_if_free(self.plan, item, place):
            self.add(item, place)


@dataclass(frozen=True)
class _Lot:
    middle: float
    width: float
    gap: float
    green: bool

    @property
    def gap_middle(self) -> float:
        return self.middle - (self.width + self.gap) / 2


def _lots(cad: Modeller, start: float, end: float) -> Iterator[_Lot]:
    while True:
        gap = cad.between(2.6, 9.0) if cad.chance(0.5) else 0.0
        width = min(cad.between(MIN_WIDTH, MAX_WIDTH), end - start - gap)
        if width < MIN_WIDTH:
            return
        yield _Lot(start + gap + width / 2, width, gap, cad.chance(0.2))
        start += gap + width


def _sides() -> tuple[tuple[str, Floats], ...]:
    """Return each side's name and frame (4, 4): x along the street, y away from the street."""
    return (("left", np.eye(4)), ("right", pose(turn=180)))


def _houses(street: _Street) -> None:
    for side, frame in _sides():
        cad = street.cad(f"houses {side}")
        end = street.length / 2 - 2.5
        for lot in _lots(cad, -end, end):
            use = _green_lot if lot.green else _house_lot
            use(street, cad, lot, frame)
            if lot.gap > 0.0:
                _alley(street, cad, lot, frame)
        wall = street_objects.garden_wall(cad, 2 * end, 1.3)
        street.add(wall, frame @ pose(0.0, HALF_WIDTH - 0.5, PAVEMENT_Z))


def _house_lot(street: _Street, cad: Modeller, lot: _Lot, frame: Floats) -> None:
    setback = cad.between(2.2, 4.5) if cad.chance(0.35) else cad.between(0.0, 0.35)
    place = frame @ pose(lot.middle, PROPERTY_Y + setback, PAVEMENT_Z)
    street.add(house(cad, lot.width, cad.between(9.0, 12.0)), place)
    if setback > 1.0:
        _garden(street, cad, lot, setback, frame)


def _green_lot(street: _Street, cad: Modeller, lot: _Lot, frame: Floats) -> None:
    width = lot.width * cad.between(0.5, 0.8)
    street.add(_border(cad)(cad, width), frame @ pose(lot.middle, PROPERTY_Y + 0.4, PAVEMENT_Z))
    for maker in (
        street_objects.tree,
        street_objects.tree,
        street_objects.bush,
        street_objects.bush,
    ):
        x = lot.middle + cad.between(-0.4, 0.4) * lot.width
        y = PROPERTY_Y + cad.between(3.5, 18.0)
        street.add(maker(cad), frame @ pose(x, y, PAVEMENT_Z))


def _garden(street: _Street, cad: Modeller, lot: _Lot, depth: float, frame: Floats) -> None:
    border = _border(cad)
    part = (lot.width - 1.4) / 2
    for side in (-1, 1):
        x = lot.middle + side * (lot.width - part) / 2
        street.add(border(cad, part - 0.1), frame @ pose(x, PROPERTY_Y + 0.4, PAVEMENT_Z))
        x += cad.between(-0.3, 0.3) * part
        y = PROPERTY_Y + depth * cad.between(0.5, 0.6)
        street.add(street_objects.bush(cad), frame @ pose(x, y, PAVEMENT_Z))


def _alley(street: _Street, cad: Modeller, lot: _Lot, frame: Floats) -> None:
    if cad.chance(0.6):
        width, y = lot.gap - 0.2, PROPERTY_Y + cad.between(0.5, 4.0)
        if cad.chance(0.5):
            width *= 0.55
        street.add(_border(cad)(cad, width), frame @ pose(lot.gap_middle, y, PAVEMENT_Z))
    if cad.chance(0.7):
        y = PROPERTY_Y + cad.between(15.5, 19.0)
        street.add(street_objects.tree(cad), frame @ pose(lot.gap_middle, y, PAVEMENT_Z))


def _border(cad: Modeller) -> Callable[[Modeller, float], Item]:
    low_wall = partial(street_objects.garden_wall, height=cad.between(0.6, 1.0))
    kinds: tuple[Callable[[Modeller, float], Item], ...]
    kinds = (street_objects.fence, street_objects.hedge, low_wall)
    return cad.pick(kinds)


def _ends(street: _Street) -> None:
    cad, away = street.cad("ends"), street.length / 2 + CROSS_STREET + END_PAVEMENT
    ahead, behind = pose(turn=-90), pose(turn=90)
    for lot in _lots(cad, 1.0 - HALF_WIDTH, HALF_WIDTH - 1.0):
        if not lot.green:
            place = ahead @ pose(lot.middle, away + cad.between(0.0, 0.3), PAVEMENT_Z)
            street.add(house(cad, lot.width, cad.between(8.5, 9.5)), place)
    wall = street_objects.garden_wall(cad, 2 * HALF_WIDTH, 0.9)
    street.add(wall, behind @ pose(0.0, away + 0.5, PAVEMENT_Z))
    for y in np.arange(5.0 - HALF_WIDTH, HALF_WIDTH - 4.0, 12.0):
        spot = (float(y) + cad.between(-2, 2), away + cad.between(3.5, 9.0), PAVEMENT_Z)
        street.add(street_objects.tree(cad), behind @ pose(*spot))


def _street_furniture(street: _Street) -> None:
    cad, end = street.cad("fittings"), street.length / 2 - 8.0
    sides = dict(_sides())
    _bus_stop(street, cad, sides[cad.pick(tuple(sides))])
    lamp = cad.pick((street_objects.arm_lamp, street_objects.globe_lamp))
    for frame in sides.values():
        for x in np.arange(6.0 - end, end, 28.0):
            street.put(lamp(cad), frame @ pose(float(x), _KERBSIDE - 0.15, PAVEMENT_Z))
        for corner in (-1, 1):
            for k in range(int(cad.rng.integers(3, 6))):
                x = corner * (end + 3.5 - 1.6 * k)
                street.put(street_objects.bollard(cad), frame @ pose(x, ROAD + 0.45, PAVEMENT_Z))
        _scatter(street, cad, frame, street_objects.sign, 7, _KERBSIDE - 0.2)
        _scatter(street, cad, frame, street_objects.bench, 2, PROPERTY_Y - 0.6)
        _scatter(street, cad, frame, street_objects.litter_bin, 4, _KERBSIDE)
        _scatter(street, cad, frame, street_objects.cabinet, 2, PROPERTY_Y - 0.4)


def _scatter(
    street: _Street, cad: Modeller, frame: Floats, maker: Maker, per_200_m: int, y: float
) -> None:
    """Put items at random free positions along a side, `per_200_m` in 200 m of street."""
    end = street.length / 2 - 8.0
    for _ in range(max(1, round(per_200_m * street.length / 200.0))):
        street.put(maker(cad), frame @ pose(cad.between(-end, end), y, PAVEMENT_Z))


def _bus_stop(street: _Street, cad: Modeller, frame: Floats) -> None:
    length, depth = street_objects.SHELTER
    x, y = cad.between(-0.3, 0.3) * street.length, ROAD + 1.5
    street.put(street_objects.shelter(cad), frame @ pose(x, y, PAVEMENT_Z))
    street.put(street_objects.sign(cad), frame @ pose(x - length, _KERBSIDE - 0.2, PAVEMENT_Z))
    before = footprint((x - 9.0, ROAD - PARKING), (x + 9.0, y - depth / 2), frame)
    street.plan.occupy(before, 0.0, _CLEAR_HEIGHT)


def _trees(street: _Street) -> None:
    for side, frame in _sides():
        cad = street.cad(f"trees {side}")
        x, end = -street.length / 2 + 9.0, street.length / 2 - 9.0
        while x < end:
            street.put(street_objects.tree(cad), frame @ pose(x, _KERBSIDE + 0.1, PAVEMENT_Z))
            x += cad.between(10.0, 18.0)


def _cars(street: _Street) -> None:
    slope = float(np.degrees(np.arctan2(road_height(0.0), ROAD)))
    for side, frame in _sides():
        cad = street.cad(f"cars {side}")
        x, end = -street.length / 2 + 12.0, street.length / 2 - 12.0
        while x < end:
            if cad.chance(0.52):
                y = ROAD - PARKING / 2 + cad.between(-0.08, 0.08)
                turn = 180.0 + cad.between(-1.5, 1.5)
                place = pose(x, y, road_height(y), turn=turn, tilt=slope)
                street.put(_car(cad), frame @ place)
            x += cad.between(5.6, 6.6)


def _car(cad: Modeller) -> Item:
    kind = int(cad.rng.choice(4, p=(0.4, 0.4, 0.12, 0.08)))
    return [Body("car", "car", join([body.placed() for body in car(cad, kind)]))]
