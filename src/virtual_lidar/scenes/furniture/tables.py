from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from virtual_lidar.scenes.bodies import Body, Item, moved
from virtual_lidar.scenes.furniture import small
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import Outline, arc, curve, line, rounded_rectangle
from virtual_lidar.scenes.solids import extrude
from virtual_lidar.scenes.surfaces import Surface, join

Maker = Callable[[Modeller], Item]
DESK_CLUTTER: tuple[Maker, ...] = (
    small.mug, small.papers, small.books, small.desk_lamp, small.telephone, small.bottle,
    small.ball, small.vase,
)  # fmt: skip
TABLE_CLUTTER: tuple[Maker, ...]
TABLE_CLUTTER = (small.mug, small.papers, small.bottle, small.laptop, small.books)


def desk(cad: Modeller) -> Item:
    width, depth, height = cad.between(1.3, 1.7), cad.between(0.7, 0.8), cad.between(0.71, 0.76)
    top = cad.slab(width, depth, 0.028, 0.03).at(z=height - 0.028)
    frame = cad.pick((_panel_legs, _tube_legs))(cad, width, depth, height - 0.028)
    drawers = _drawer_unit(cad, 0.42, depth - 0.15, height - 0.09)
    side = cad.pick((-1, 1))
    unit = [Body("drawers", "clutter", drawers.at(x=side * (width / 2 - 0.29)))]
    screens = 2 if width > 1.5 and cad.chance(0.5) else 1
    item = [Body("desk", "table", join([top, *frame])), *unit]
    for k in range(screens):
        x = (k - (screens - 1) / 2) * 0.62
        turn = -18 * (2 * k - 1) if screens > 1 else cad.between(-8, 8)
        item += moved(small.monitor(cad), x, 0.16, height, turn=turn)
    item += moved(small.keyboard(cad), 0.0, -0.14, height, turn=cad.between(-5, 5))
    item += moved(small.mouse(cad), 0.32, -0.15, height, turn=cad.between(-20, 20))
    spots = [(-width / 2 + 0.17, -0.1), (width / 2 - 0.17, -0.12)]
    spots += [(-width / 2 + 0.17, 0.2), (width / 2 - 0.17, 0.2)] if screens == 1 else []
    return item + scattered(cad, DESK_CLUTTER, spots, height)


def scattered(
    cad: Modeller, makers: Sequence[Maker], spots: Sequence[tuple[float, float]], height: float
) -> Item:
    """Make small random objects on a plane at the given height.

    At each of the positions `spots` (x, y), an object is placed with probability 0.8.
    """
    item: Item = []
    for x, y in spots:
        if cad.chance(0.8):
            item += moved(cad.pick(makers)(cad), x, y, height, turn=cad.between(-30, 30))
    return item


def _panel_legs(cad: Modeller, width: float, depth: float, height: float) -> list[Surface]:
    sides = cad.box(0.025, depth - 0.04, height).at_sides(width / 2 - 0.04)
    return [*sides, cad.box(width - 0.1, 0.018, 0.4).at(y=depth / 2 - 0.06, z=height - 0.4)]


def _tube_legs(cad: Modeller, width: float, depth: float, height: float) -> list[Surface]:
    x, y = width / 2 - 0.06, depth / 2 - 0.06
    legs = cad.cylinder(0.025, height).at_corners(x, y)
    beams = [cad.rod((-x, b * y, height - 0.04), (x, b * y, height - 0.04), 0.015) for b in (-1, 1)]
    return [*legs, *beams]


def _drawer_unit(cad: Modeller, width: float, depth: float, height: float) -> Surface:
    body = cad.box(width, depth, height - 0.06).at(z=0.06)
    wheels = cad.sphere(0.03).at_corners(width / 2 - 0.05, depth / 2 - 0.05, 0.03)
    parts = [body, *wheels]
    step = (height - 0.08) / 3
    for k in range(3):
        z = 0.07 + k * step
        parts.append(cad.box(width - 0.02, 0.016, step - 0.012).at(y=-depth / 2 - 0.008, z=z))
        bar, y = z + step * 0.6, -depth / 2
        ends = ((-0.06, y - 0.015, bar), (0.06, y - 0.015, bar))
        parts.append(cad.handle(*ends, y - 0.04, 0.005))
    return join(parts)


def meeting_table(cad: Modeller, length: float = 2.4, width: float = 1.1) -> Item:
    height = 0.74
    steps = max(4, cad.steps(width) // 8)
    if cad.chance(0.5):
        outline = rounded_rectangle(length, width, width * 0.32, steps)
    else:
        outline = _boat(length, width, steps)
    top = extrude(outline, 0.03).at(z=height - 0.03)
    pedestals = cad.cone(0.09, 0.06, height - 0.05).at_sides(length * 0.28, z=0.02)
    feet = cad.slab(0.12, width * 0.65, 0.03, 0.05).at_sides(length * 0.28)
    beam = cad.rod((-length * 0.28, 0, height - 0.08), (length * 0.28, 0, height - 0.08), 0.03)
    count = int(length / 0.7)
    xs, y = [(k + 0.5 - count / 2) * 0.65 for k in range(count)], width * 0.27
    spots = [(x, side) for x in xs for side in (-y, y)]
    item = [Body("meeting_table", "table", join([top, *pedestals, *feet, beam]))]
    return item + scattered(cad, TABLE_CLUTTER, spots, height)


def _boat(length: float, width: float, steps: int) -> Outline:
    x, end, sag = length / 2, width * 0.36, width * 0.14
    radius = (x**2 + sag**2) / (2 * sag)
    half = float(np.degrees(np.arcsin(x / radius)))
    low = arc((0, radius - end - sag), radius, 270 - half, 270 + half, 4 * steps)
    high = arc((0, end + sag - radius), radius, 90 - half, 90 + half, 4 * steps)
    return (*low, *line((x, -end), (x, end)), *high, *line((-x, end), (-x, -end)))


def round_table(cad: Modeller, radius: float = 0.5, height: float = 0.74) -> Item:
    wide, lid = radius * 0.6, height - 0.03
    stem = curve([(wide, 0.012), (radius * 0.3, 0.05), (0.04, 0.25), (0.035, lid)], 6)
    foot = cad.turned(line((0, 0), (wide, 0), (wide, 0.012)), stem, line((0.035, lid), (0, lid)))
    rim = arc((radius - 0.015, 0.015), 0.015, -90, 90, max(4, cad.steps(0.015) // 2))
    top = cad.turned(
        line((0, 0), (radius - 0.015, 0)), rim, line((radius - 0.015, 0.03), (0, 0.03))
    )
    top = top.at(z=height - 0.03)
    item = [Body("round_table", "table", foot + top)]
    spots = [(radius * 0.5, 0.0), (-radius * 0.3, radius * 0.4), (-radius * 0.3, -radius * 0.4)]
    return item + scattered(cad, (small.mug, small.vase, small.bowl, small.bottle), spots, height)


def coffee_table(cad: Modeller) -> Item:
    width, depth, height = cad.between(0.9, 1.2), 0.55, 0.42
    top = cad.slab(width, depth, 0.025, 0.08).at(z=height - 0.025)
    shelf = cad.slab(width - 0.12, depth - 0.12, 0.016, 0.05).at(z=0.14)
    leg = cad.cone(0.014, 0.024, height - 0.02)
    legs = leg.at_corners(width / 2 - 0.07, depth / 2 - 0.07)
    item = [Body("coffee_table", "table", join([top, shelf, *legs]))]
    makers = (small.books, small.bowl, small.mug, small.papers)
    return item + scattered(cad, makers, [(-0.25, 0.0), (0.05, 0.08), (0.3, -0.05)], height)


def workbench(cad: Modeller) -> Item:
    width, depth, height = cad.between(1.2, 1.8), 0.7, 0.78
    top = cad.slab(width, depth, 0.04, 0.02).at(z=height - 0.04)
    x, y = width / 2 - 0.05, depth / 2 - 0.05
    legs = cad.slab(0.06, 0.06, height - 0.04, 0.012).at_corners(x, y)
    beams = cad.box(width - 0.16, 0.03, 0.08).at_sides(y=y, z=height - 0.12, axis=1)
    item = [Body("workbench", "table", join([top, *legs, *beams]))]
    spots = [(-width * 0.35, 0.05), (-width * 0.1, 0.05), (width * 0.15, 0.05), (width * 0.37, 0.0)]
    makers = (small.bucket, small.papers, small.bottle, small.printer)
    return item + scattered(cad, makers, spots, height)
