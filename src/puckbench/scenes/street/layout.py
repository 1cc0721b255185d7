"""How a street is laid out: houses in rows, planting and fittings, parked cars, and a free lane."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.scenes.builder import Item, Piece, build, moved
from puckbench.scenes.modeller import Modeller
from puckbench.scenes.models.outdoors import car
from puckbench.scenes.placing import claim
from puckbench.scenes.plan import Plan, rectangle
from puckbench.scenes.street import fittings, planting
from puckbench.scenes.street.ground import (
    BEYOND,
    CROSSING,
    FAR_PAVED,
    LANE,
    PARKING,
    PAVED,
    PROPERTY,
    ROAD,
    SIDE,
    ground,
    road_height,
)
from puckbench.scenes.street.houses import LEAST_WIDTH, MOST_WIDTH, house
from puckbench.scenes.surfaces import join, pose

SENSOR_HEIGHT = 1.9
Maker = Callable[[Modeller], Item]

# Segments of curved parts: coarser than those of furniture, which is seen from nearer.
_DETAIL, _UNIT = 0.7, 0.1
_KERBSIDE = ROAD + 0.75
_FREE_ABOVE = 4.0


def make_street(name: str, seed: int, length: float) -> Mesh:
    """The labelled mesh of a street along x, its middle at the origin.

    Parameters
    ----------
    name
        Names the random stream.
    seed
        Seed of houses, planting, fittings and cars.
    length
        Between the cross streets at its ends, m.
    """
    street = _Street(
        length, lambda part: Modeller(generator(seed, "street", name, part), _DETAIL, _UNIT)
    )
    street.add(ground(street.cad("ground"), length))
    for part in (_houses, _ends, _fittings, _trees, _cars):
        part(street)
    return build(street.item)


def street_origin() -> tuple[float, float, float]:
    """Where a sensor may stand: over the middle of the lane to +x, half way along the street."""
    return (0.0, -LANE / 2, SENSOR_HEIGHT + road_height(LANE / 2))


def free_way(length: float) -> tuple[float, float]:
    """From where to where along x, from its origin, a sensor can go straight on, m.

    Nothing is within 1 m of this way.
    """
    return (-length / 2, length / 2)


@dataclass
class _Street:
    """A street being laid out: its modellers by the part they make, its pieces and its plan."""

    length: float
    cad: Callable[[str], Modeller]
    item: Item = field(default_factory=list)
    plan: Plan = field(init=False)

    def __post_init__(self) -> None:
        x = self.length / 2 + CROSSING + BEYOND
        self.plan = Plan(rectangle((-x, -SIDE), (x, SIDE), np.eye(4)))
        lanes = rectangle((-x, 0.5 - LANE), (x, LANE - 0.5), np.eye(4))
        self.plan.take(lanes, 0.0, _FREE_ABOVE)

    def add(self, item: Item, place: Floats | None = None) -> None:
        """Put an item at a pose, whatever is there."""
        self.item += item if place is None else moved(item, place)

    def put(self, item: Item, place: Floats) -> None:
        """Put an item at a pose if its space is free."""
        if claim(self.plan, item, place):
            self.add(item, place)


@dataclass(frozen=True)
class _Lot:
    """A lot along a row: its middle and width, and the width of the gap before it, m.

    One in five is no house's but a green.
    """

    middle: float
    width: float
    gap: float
    green: bool

    @property
    def gap_middle(self) -> float:
        """The middle of the gap before it."""
        return self.middle - (self.width + self.gap) / 2


def _lots(cad: Modeller, start: float, end: float) -> Iterator[_Lot]:
    """Lots of a row from start to end, with a gap before some."""
    while True:
        gap = cad.between(2.6, 9.0) if cad.chance(0.5) else 0.0
        width = min(cad.between(LEAST_WIDTH, MOST_WIDTH), end - start - gap)
        if width < LEAST_WIDTH:
            return
        yield _Lot(start + gap + width / 2, width, gap, cad.chance(0.2))
        start += gap + width


def _sides() -> tuple[tuple[str, Floats], ...]:
    """Name and frame of each side of the street: x along it, y away from it, fronts to -y."""
    return (("left", np.eye(4)), ("right", pose(turn=180)))


def _houses(street: _Street) -> None:
    """Houses along both sides, with gardens before some, and greens and alleys between them."""
    for side, frame in _sides():
        cad = street.cad(f"houses {side}")
        end = street.length / 2 - 2.5
        for lot in _lots(cad, -end, end):
            use = _green if lot.green else _built
            use(street, cad, lot, frame)
            if lot.gap > 0.0:
                _alley(street, cad, lot, frame)
        wall = fittings.garden_wall(cad, 2 * end, 1.3)
        street.add(wall, frame @ pose(0.0, SIDE - 0.5, PAVED))


def _built(street: _Street, cad: Modeller, lot: _Lot, frame: Floats) -> None:
    """A house, at the pavement or behind a front garden."""
    setback = cad.between(2.2, 4.5) if cad.chance(0.35) else cad.between(0.0, 0.35)
    place = frame @ pose(lot.middle, PROPERTY + setback, PAVED)
    street.add(house(cad, lot.width, cad.between(9.0, 12.0)), place)
    if setback > 1.0:
        _garden(street, cad, lot, setback, frame)


def _green(street: _Street, cad: Modeller, lot: _Lot, frame: Floats) -> None:
    """An open lot: a border towards the street, trees and bushes."""
    width = lot.width * cad.between(0.5, 0.8)
    street.add(_border(cad)(cad, width), frame @ pose(lot.middle, PROPERTY + 0.4, PAVED))
    for maker in (planting.tree, planting.tree, planting.bush, planting.bush):
        x, y = lot.middle + cad.between(-0.4, 0.4) * lot.width, PROPERTY + cad.between(3.5, 18.0)
        street.add(maker(cad), frame @ pose(x, y, PAVED))


def _garden(street: _Street, cad: Modeller, lot: _Lot, depth: float, frame: Floats) -> None:
    """A front garden: bushes, and a fence, hedge or wall with a way through it."""
    border = _border(cad)
    part = (lot.width - 1.4) / 2
    for side in (-1, 1):
        x = lot.middle + side * (lot.width - part) / 2
        street.add(border(cad, part - 0.1), frame @ pose(x, PROPERTY + 0.4, PAVED))
        spot = (x + cad.between(-0.3, 0.3) * part, PROPERTY + depth * cad.between(0.5, 0.6), PAVED)
        street.add(planting.bush(cad), frame @ pose(*spot))


def _alley(street: _Street, cad: Modeller, lot: _Lot, frame: Floats) -> None:
    """A gap between houses: open or closed by a border, with a tree far behind in some."""
    if cad.chance(0.6):
        width, y = lot.gap - 0.2, PROPERTY + cad.between(0.5, 4.0)
        if cad.chance(0.5):
            width *= 0.55
        street.add(_border(cad)(cad, width), frame @ pose(lot.gap_middle, y, PAVED))
    if cad.chance(0.7):
        y = PROPERTY + cad.between(15.5, 19.0)
        street.add(planting.tree(cad), frame @ pose(lot.gap_middle, y, PAVED))


def _border(cad: Modeller) -> Callable[[Modeller, float], Item]:
    """A fence, a hedge or a low wall, to be made at any length."""
    low_wall = partial(fittings.garden_wall, height=cad.between(0.6, 1.0))
    kinds: tuple[Callable[[Modeller, float], Item], ...]
    kinds = (fittings.fence, planting.hedge, low_wall)
    return cad.pick(kinds)


def _ends(street: _Street) -> None:
    """Houses across the last end of the street, over x > 0; trees, and a low wall, at the first."""
    cad, away = street.cad("ends"), street.length / 2 + CROSSING + FAR_PAVED
    ahead, behind = pose(turn=-90), pose(turn=90)
    for lot in _lots(cad, 1.0 - SIDE, SIDE - 1.0):
        if not lot.green:
            place = ahead @ pose(lot.middle, away + cad.between(0.0, 0.3), PAVED)
            street.add(house(cad, lot.width, cad.between(8.5, 9.5)), place)
    wall = fittings.garden_wall(cad, 2 * SIDE, 0.9)
    street.add(wall, behind @ pose(0.0, away + 0.5, PAVED))
    for y in np.arange(5.0 - SIDE, SIDE - 4.0, 12.0):
        spot = (float(y) + cad.between(-2, 2), away + cad.between(3.5, 9.0), PAVED)
        street.add(planting.tree(cad), behind @ pose(*spot))


def _fittings(street: _Street) -> None:
    """A bus stop, lamps, signs, bollards at the corners, benches, bins and cabinets."""
    cad, end = street.cad("fittings"), street.length / 2 - 8.0
    sides = dict(_sides())
    _bus_stop(street, cad, sides[cad.pick(tuple(sides))])
    lamp = cad.pick((fittings.curved_lamp, fittings.globe_lamp))
    for frame in sides.values():
        for x in np.arange(6.0 - end, end, 28.0):
            street.put(lamp(cad), frame @ pose(float(x), _KERBSIDE - 0.15, PAVED))
        for corner in (-1, 1):
            for k in range(int(cad.rng.integers(3, 6))):
                x = corner * (end + 3.5 - 1.6 * k)
                street.put(fittings.bollard(cad), frame @ pose(x, ROAD + 0.45, PAVED))
        _strewn(street, cad, frame, fittings.sign, 7, _KERBSIDE - 0.2)
        _strewn(street, cad, frame, fittings.bench, 2, PROPERTY - 0.6)
        _strewn(street, cad, frame, fittings.bin_, 4, _KERBSIDE)
        _strewn(street, cad, frame, fittings.cabinet, 2, PROPERTY - 0.4)


def _strewn(
    street: _Street, cad: Modeller, frame: Floats, maker: Maker, per_200_m: int, y: float
) -> None:
    """Items anywhere along one side, as many as fit of `per_200_m`."""
    end = street.length / 2 - 8.0
    for _ in range(max(1, round(per_200_m * street.length / 200.0))):
        street.put(maker(cad), frame @ pose(cad.between(-end, end), y, PAVED))


def _bus_stop(street: _Street, cad: Modeller, frame: Floats) -> None:
    """A shelter with a sign before it, where no car may park."""
    length, depth = fittings.SHELTER
    x, y = cad.between(-0.3, 0.3) * street.length, ROAD + 1.5
    street.put(fittings.shelter(cad), frame @ pose(x, y, PAVED))
    street.put(fittings.sign(cad), frame @ pose(x - length, _KERBSIDE - 0.2, PAVED))
    before = rectangle((x - 9.0, ROAD - PARKING), (x + 9.0, y - depth / 2), frame)
    street.plan.take(before, 0.0, _FREE_ABOVE)


def _trees(street: _Street) -> None:
    """Trees along the kerbs."""
    for side, frame in _sides():
        cad = street.cad(f"trees {side}")
        x, end = -street.length / 2 + 9.0, street.length / 2 - 9.0
        while x < end:
            street.put(planting.tree(cad), frame @ pose(x, _KERBSIDE + 0.1, PAVED))
            x += cad.between(10.0, 18.0)


def _cars(street: _Street) -> None:
    """Cars parked along the kerbs, heading as the traffic of their side does, or nearly."""
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
    """One of the four kinds of car, vans and pick-ups less often."""
    kind = int(cad.rng.choice(4, p=(0.4, 0.4, 0.12, 0.08)))
    return [Piece("car", "car", join([piece.placed() for piece in car(cad, kind)]))]
