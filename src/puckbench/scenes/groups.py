"""Furniture that belongs together: a desk with its chair, a table with the chairs around it."""

from __future__ import annotations

from puckbench.scenes.builder import Item, Piece, moved
from puckbench.scenes.furniture import plants, seating, small, tables
from puckbench.scenes.modeller import Modeller
from puckbench.scenes.surfaces import Surface, join, pose


def workplace(cad: Modeller) -> Item:
    """Desk with an office chair, pushed about a little."""
    place = pose(cad.between(-0.15, 0.15), -0.62, 0, turn=180 + cad.between(-40, 40))
    return tables.desk(cad) + moved(seating.office_chair(cad), place)


def double_workplace(cad: Modeller) -> Item:
    """Two workplaces face to face."""
    one, other = workplace(cad), workplace(cad)
    return moved(one, pose(0, -0.42, 0)) + moved(other, pose(0, 0.42, 0, turn=180))


def meeting(cad: Modeller, length: float = 2.4, width: float = 1.1) -> Item:
    """Long table with chairs of one kind along both sides and at one end."""
    item = tables.meeting_table(cad, length, width)
    chair = cad.pick((seating.chair, seating.shell_chair, seating.office_chair))
    count = int(length / 0.75)
    for k in range(count):
        x = (k - (count - 1) / 2) * length / count * 0.92
        for side in (-1, 1):
            turn = (180 if side < 0 else 0) + cad.between(-14, 14)
            away = width / 2 + cad.between(0.18, 0.42)
            item += moved(chair(cad), pose(x, side * away, 0, turn=turn))
    return item + moved(chair(cad), pose(length / 2 + 0.4, 0, 0, turn=-90 + cad.between(-25, 25)))


def cafe(cad: Modeller) -> Item:
    """Round table with three or four chairs."""
    item = tables.round_table(cad)
    chair = cad.pick((seating.chair, seating.shell_chair, seating.stool))
    count = int(cad.rng.integers(3, 5))
    for k in range(count):
        turn = 360.0 * k / count + cad.between(-12, 12)
        item += moved(
            moved(chair(cad), pose(0, 0.66, 0, turn=cad.between(-15, 15))), pose(turn=turn)
        )
    return item


def sitting_corner(cad: Modeller) -> Item:
    """Sofa, coffee table and an armchair across."""
    table = moved(tables.coffee_table(cad), pose(0.1, -0.95, 0, turn=cad.between(-4, 4)))
    armchair = moved(seating.sofa(cad, 1), pose(-0.1, -2.0, 0, turn=180 + cad.between(-25, 25)))
    return seating.sofa(cad, 3) + table + armchair


def row_of_seats(cad: Modeller, count: int) -> Item:
    """Auditorium seats side by side."""
    item: Item = []
    for k in range(count):
        item += moved(seating.row_seat(cad), pose((k - (count - 1) / 2) * 0.6, 0, 0))
    return item


def lectern(cad: Modeller) -> Item:
    """Speaker's desk with a sloping top, a bent microphone and a bottle."""
    body = cad.slab(0.6, 0.45, 1.05, 0.06)
    top = cad.box(0.66, 0.52, 0.03).at(y=0.0, z=1.08, tilt=14)
    neck = cad.smooth(
        [(0.15, -0.1, 1.06), (0.15, -0.12, 1.25), (0.13, 0.05, 1.36), (0.12, 0.12, 1.34)]
    )
    stand = cad.tube(neck, 0.006) + cad.superquadric((0.02, 0.03, 0.02)).at(*neck[-1])
    return [Piece("lectern", "table", join([body, top])), *small.clutter("microphone", stand)]


def tiers(
    cad: Modeller, width: float, step: tuple[float, float], count: int, at_back: float
) -> Item:
    """Stepped floor rising towards +y: `count` steps of (depth, rise), the last `at_back` deep."""
    depth, rise = step
    parts: list[Surface] = []
    for k in range(count):
        reach = (count - 1 - k) * depth + at_back
        parts.append(cad.box(width, reach, rise).at(y=-reach / 2, z=k * rise))
    return [Piece("tiers", "floor", join(parts))]


def plant_group(cad: Modeller) -> Item:
    """A plant, one of three kinds."""
    return cad.pick((plants.plant, plants.small_tree, plants.cactus))(cad)


def balls(cad: Modeller) -> Item:
    """Three balls of different sizes."""
    spots = ((0.0, 0.0, 0.16), (0.3, 0.05, 0.11), (0.12, 0.3, 0.08))
    return [one for x, y, r in spots for one in moved(small.ball(cad, r), pose(x, y))]
