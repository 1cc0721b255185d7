"""Furniture that is placed together, such as a desk and its chair."""

from __future__ import annotations

from virtual_lidar.scenes.bodies import Body, Item, moved, posed
from virtual_lidar.scenes.furniture import plants, seating, small, tables
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.surfaces import Surface, join, pose


def workstation(cad: Modeller) -> Item:
    place = pose(cad.between(-0.15, 0.15), -0.62, 0, turn=180 + cad.between(-40, 40))
    return tables.desk(cad) + posed(seating.office_chair(cad), place)


def facing_workstations(cad: Modeller) -> Item:
    first, second = workstation(cad), workstation(cad)
    return moved(first, 0, -0.42, 0) + moved(second, 0, 0.42, 0, turn=180)


def meeting_group(cad: Modeller, length: float = 2.4, width: float = 1.1) -> Item:
    item = tables.meeting_table(cad, length, width)
    chair = cad.pick((seating.chair, seating.shell_chair, seating.office_chair))
    count = int(length / 0.75)
    for k in range(count):
        x = (k - (count - 1) / 2) * length / count * 0.92
        for side in (-1, 1):
            turn = (180 if side < 0 else 0) + cad.between(-14, 14)
            away = width / 2 + cad.between(0.18, 0.42)
            item += moved(chair(cad), x, side * away, 0, turn=turn)
    return item + moved(chair(cad), length / 2 + 0.4, 0, 0, turn=-90 + cad.between(-25, 25))


def cafe_group(cad: Modeller) -> Item:
    item = tables.round_table(cad)
    chair = cad.pick((seating.chair, seating.shell_chair, seating.stool))
    count = int(cad.rng.integers(3, 5))
    for k in range(count):
        turn = 360.0 * k / count + cad.between(-12, 12)
        item += moved(moved(chair(cad), 0, 0.66, 0, turn=cad.between(-15, 15)), turn=turn)
    return item


def seating_group(cad: Modeller) -> Item:
    table = moved(tables.coffee_table(cad), 0.1, -0.95, 0, turn=cad.between(-4, 4))
    armchair = moved(seating.sofa(cad, 1), -0.1, -2.0, 0, turn=180 + cad.between(-25, 25))
    return seating.sofa(cad, 3) + table + armchair


def auditorium_row(cad: Modeller, count: int) -> Item:
    item: Item = []
    for k in range(count):
        item += moved(seating.auditorium_seat(cad), (k - (count - 1) / 2) * 0.6, 0, 0)
    return item


def lectern(cad: Modeller) -> Item:
    body = cad.slab(0.6, 0.45, 1.05, 0.06)
    top = cad.box(0.66, 0.52, 0.03).at(y=0.0, z=1.08, tilt=14)
    path = [(0.15, -0.1, 1.06), (0.15, -0.12, 1.25), (0.13, 0.05, 1.36), (0.12, 0.12, 1.34)]
    neck = cad.smooth(path)
    stand = cad.tube(neck, 0.006) + cad.superquadric((0.02, 0.03, 0.02)).at(*neck[-1])
    return [Body("lectern", "table", join([body, top])), *small.clutter("microphone", stand)]


def stepped_floor(
    cad: Modeller, width: float, step: tuple[float, float], count: int, at_back: float
) -> Item:
    """Make steps that rise towards +y.

    Parameters
    ----------
    width
        Width of the steps, m.
    step
        Depth and height of a step, m.
    count
        Number of steps.
    at_back
        Depth of the last step, m.
    """
    depth, rise = step
    parts: list[Surface] = []
    for k in range(count):
        reach = (count - 1 - k) * depth + at_back
        parts.append(cad.box(width, reach, rise).at(y=-reach / 2, z=k * rise))
    return [Body("tiers", "floor", join(parts))]


def random_plant(cad: Modeller) -> Item:
    return cad.pick((plants.plant, plants.small_tree, plants.cactus))(cad)


def balls(cad: Modeller) -> Item:
    spots = ((0.0, 0.0, 0.16), (0.3, 0.05, 0.11), (0.12, 0.3, 0.08))
    return [body for x, y, r in spots for body in moved(small.ball(cad, r), x, y)]
