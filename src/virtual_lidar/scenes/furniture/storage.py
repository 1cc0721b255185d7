from __future__ import annotations

import numpy as np

from virtual_lidar.scenes.bodies import Body, Item, item_bounds, moved
from virtual_lidar.scenes.furniture import small
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import (
    arc,
    curve,
    line,
    point,
    rectangle,
    rounded_rectangle,
    shifted,
)
from virtual_lidar.scenes.solids import extrude
from virtual_lidar.scenes.surfaces import join

SHELF_MAKERS = (small.carton, small.bottle, small.ball, small.vase, small.papers, small.books)
RACK_MAKERS = (small.carton, small.carton, small.bucket, small.bottle, small.ball, small.printer)


def bookcase(cad: Modeller, width: float = 0.9, levels: int = 5) -> Item:
    depth, height = 0.3, 0.12 + 0.37 * levels
    sides = cad.box(0.02, depth, height).at_sides(width / 2 - 0.01)
    heights = [0.07 + 0.37 * k for k in range(levels)]
    shelves = [cad.box(width - 0.04, depth - 0.01, 0.02).at(z=z) for z in [*heights, height - 0.02]]
    back = cad.box(width - 0.04, 0.008, height - 0.07).at(y=depth / 2 - 0.004, z=0.07)
    plinth = cad.box(width - 0.04, 0.02, 0.07).at(y=-depth / 2 + 0.04)
    item = [Body("bookcase", "bookcase", join([*sides, *shelves, back, plinth]))]
    for z in heights:
        content = _row_of_books if cad.chance(0.65) else _other_objects
        item += moved(content(cad, width - 0.06), 0, 0, z + 0.02)
    return item


def _row_of_books(cad: Modeller, width: float) -> Item:
    item: Item = []
    x = -width / 2
    end = width / 2 - cad.between(0.08, 0.4)
    while x < end:
        height, thickness = cad.between(0.2, 0.31), cad.between(0.018, 0.05)
        volume = small.standing_book(cad, height, thickness)
        item += moved(volume, x, cad.between(-0.02, 0.02), 0)
        x += thickness + 0.001
    lean = small.standing_book(cad, 0.24, 0.03)
    return item + moved(lean, x + 0.062, 0, 0.0, roll=-14)


def _other_objects(cad: Modeller, width: float) -> Item:
    item: Item = []
    for x in (-width * 0.32, 0.0, width * 0.32):
        if cad.chance(0.85):
            content = cad.pick(SHELF_MAKERS)(cad)
            item += moved(_fitted(content, (0.26, 0.24, 0.3)), x, 0, 0, turn=cad.between(-20, 20))
    return item


def _fitted(item: Item, size: tuple[float, float, float]) -> Item:
    low, high = item_bounds(item)
    return moved(item, scale=min(1.0, float(np.min(np.array(size) / (high - low)))))


def rack(cad: Modeller, width: float = 1.2, levels: int = 4) -> Item:
    depth, height = 0.5, 2.0
    posts = cad.box(0.035, 0.035, height).at_corners(width / 2 - 0.02, depth / 2 - 0.02)
    heights = np.linspace(0.12, height - 0.05, levels + 1)
    boards = [cad.box(width - 0.01, depth - 0.01, 0.03).at(z=z) for z in heights]
    x, y = width / 2 - 0.03, depth / 2 - 0.02
    braces = [cad.rod((-a, y, 0.2), (a, y, height - 0.2), 0.006) for a in (-x, x)]
    item = [Body("rack", "bookcase", join([*posts, *boards, *braces]))]
    gap = float(heights[1] - heights[0]) - 0.06
    for z in heights[:-1]:
        for x in (np.arange(3) - 1) * width / 3.2:
            if cad.chance(0.85):
                content = _fitted(cad.pick(RACK_MAKERS)(cad), (width / 3.6, depth - 0.1, gap))
                item += moved(content, float(x), 0, float(z) + 0.03, turn=cad.between(-8, 8))
    return item


def cabinet(cad: Modeller, width: float = 0.9, height: float = 1.9) -> Item:
    depth = 0.42
    body = cad.box(width, depth, height - 0.05).at(z=0.05)
    plinth = cad.box(width - 0.06, depth - 0.06, 0.05)
    y = -depth / 2 - 0.009
    doors = cad.box(width / 2 - 0.006, 0.018, height - 0.08).at_sides(width / 4, y, 0.065)
    low, high = height * 0.45, height * 0.62
    handles = [cad.handle((x, y, low), (x, y, high), y - 0.045, 0.006) for x in (-0.04, 0.04)]
    item = [Body("cabinet", "clutter", join([body, plinth, *doors, *handles]))]
    if cad.chance(0.6):
        top = _fitted(cad.pick((small.carton, small.papers, small.vase))(cad), (0.4, 0.4, 0.35))
        item += moved(top, cad.between(-0.15, 0.15), 0, height, turn=cad.between(-15, 15))
    return item


def sideboard(cad: Modeller) -> Item:
    item = cabinet(cad, 1.2, 0.8)[:1]
    makers = (small.printer, small.vase, small.books, small.bowl, small.desk_lamp)
    for x in (-0.4, 0.0, 0.4):
        content = cad.pick(makers)(cad)
        item += moved(_fitted(content, (0.4, 0.36, 0.6)), x, 0, 0.8, turn=cad.between(-15, 15))
    return item


def lockers(cad: Modeller, columns: int = 4) -> Item:
    width, depth, height = 0.38, 0.48, 1.85
    parts = [cad.box(columns * width, depth, height)]
    for k in range(columns):
        x = (k - (columns - 1) / 2) * width
        parts.append(cad.box(width - 0.012, 0.014, height - 0.06).at(x, -depth / 2 - 0.007, 0.03))
        slits = height - 0.2 - 0.035 * np.arange(5)
        parts += [cad.box(0.2, 0.01, 0.012).at(x, -depth / 2 - 0.019, z) for z in slits]
        parts.append(cad.cylinder(0.014, 0.03).at(x + 0.13, -depth / 2 - 0.014, 1.0, tilt=90))
    return [Body("lockers", "clutter", join(parts))]


def copier(cad: Modeller) -> Item:
    body = cad.slab(0.65, 0.6, 0.72, 0.03).at(z=0.06)
    feet = cad.cylinder(0.03, 0.06).at_corners(0.26, 0.24)
    trays = [cad.box(0.6, 0.02, 0.13).at(y=-0.308, z=0.1 + 0.15 * k) for k in range(4)]
    heights = [0.2 + 0.15 * k for k in range(4)]
    grips = [cad.rod((-0.1, -0.325, z), (0.1, -0.325, z), 0.01) for z in heights]
    head = cad.slab(0.62, 0.55, 0.14, 0.04).at(y=0.02, z=0.92)
    stem = cad.box(0.14, 0.5, 0.15).at(x=-0.23, y=0.03, z=0.78)
    back = cad.box(0.6, 0.12, 0.15).at(y=0.22, z=0.78)
    lid = cad.cushion(0.58, 0.5, 0.12, 0.25).at(y=0.03, z=1.05)
    panel = cad.slab(0.24, 0.15, 0.02, 0.02).at(0.16, -0.31, 1.04, tilt=25)
    tray = cad.box(0.3, 0.4, 0.015).at(x=0.47, z=0.6, roll=-15)
    return small.clutter("copier", body, *feet, *trays, *grips, head, stem, back, lid, panel, tray)


def water_cooler(cad: Modeller) -> Item:
    body = cad.slab(0.32, 0.32, 0.95, 0.05)
    taps = cad.cylinder(0.012, 0.06).at_sides(0.06, -0.16, 0.8, tilt=90)
    drip = cad.slab(0.22, 0.08, 0.02, 0.02).at(y=-0.19, z=0.62)
    bottle = cad.turned(
        line((0, 0.95), (0.04, 0.95), (0.04, 1.0)),
        curve([(0.04, 1.0), (0.12, 1.06), (0.135, 1.12), (0.13, 1.2), (0.135, 1.3)], 6),
        line((0.135, 1.3), (0.135, 1.38)),
        arc((0.105, 1.38), 0.03, 0, 90, max(3, cad.steps(0.03) // 4)),
        line((0.105, 1.41), (0, 1.41)),
    )
    return small.clutter("water_cooler", body, *taps, drip, bottle)


def fridge(cad: Modeller) -> Item:
    body = cad.slab(0.6, 0.58, 1.75, 0.03).at(z=0.03)
    doors = [
        cad.slab(0.59, z, 0.04, 0.02).at(y=-0.29, z=at + z / 2, tilt=90)
        for at, z in ((0.06, 1.1), (1.18, 0.58))
    ]
    spans, x, y = ((0.7, 1.1), (1.24, 1.5)), -0.24, -0.33
    bars = [cad.handle((x, y, low), (x, y, high), -0.38, 0.01) for low, high in spans]
    feet = cad.cylinder(0.03, 0.03).at_corners(0.22, 0.2)
    return small.clutter("fridge", body, *doors, *bars, *feet)


def kitchenette(cad: Modeller) -> Item:
    width, depth, height = 1.8, 0.6, 0.9
    base = cad.box(width, depth - 0.04, height - 0.04).at(y=0.02)
    door, knob, y = cad.box(0.44, 0.016, 0.68), cad.sphere(0.014), -depth / 2
    doors = [door.at(-0.675 + 0.45 * k, y + 0.032, 0.1) for k in range(4)]
    knobs = [knob.at(-0.53 + 0.45 * k, y + 0.012, 0.7) for k in range(4)]
    hole = rounded_rectangle(0.44, 0.36, 0.06, max(3, cad.steps(0.06) // 4))
    counter = extrude(rectangle(width, depth), 0.04, [shifted(hole, 0.45, -0.02)])
    counter = counter.at(z=height - 0.04)
    basin = extrude(hole, 0.002).at(z=-0.002).at(0.45, -0.02, height - 0.04)
    tap = cad.pipe([(0, 0.22, 0), (0, 0.22, 0.3), (0, 0.02, 0.3), (0, 0.02, 0.2)], 0.013, 0.07)
    lever = cad.rod((0.02, 0.22, 0.08), (0.1, 0.2, 0.12), 0.008)
    body = join([base, *doors, *knobs, counter, basin, (tap + lever).at(x=0.45, z=height)])
    item = [Body("kitchenette", "clutter", body)]
    for maker, x in ((small.microwave, -0.6), (small.bottle, -0.2), (small.mug, -0.05)):
        item += moved(maker(cad), x, 0.02, height, turn=cad.between(-10, 10))
    return item


def drum(cad: Modeller) -> Item:
    hoops = [cad.torus(0.285, 0.012).at(z=z) for z in (0.012, 0.3, 0.58, 0.868)]
    bung = cad.cylinder(0.03, 0.015).at(x=0.17, z=0.86)
    return small.clutter("drum", cad.cylinder(0.285, 0.86), *hoops, bung)


def gas_cylinder(cad: Modeller) -> Item:
    radius, height = 0.115, 1.2
    side = line((0, 0), (radius, 0), (radius, height))
    shoulder = arc((0, height), radius, 0, 70, cad.steps(radius) // 4)
    r, z = point(shoulder[0].points[-1])
    neck = line((r, z), (0.02, z + 0.04), (0.02, z + 0.09), (0, z + 0.09))
    wheel = cad.torus(0.035, 0.007).at(z=z + 0.1)
    return small.clutter("gas_bottle", cad.turned(side, shoulder, neck), wheel)


def ladder(cad: Modeller) -> Item:
    rails = cad.legs((0.22, 0.42), (0.17, 0.03), 1.5, 0.018)
    treads = [
        cad.box(0.42 - 0.06 * t, 0.09, 0.025).at(y=-0.42 + 0.39 * t, z=1.5 * t - 0.012)
        for t in (0.2, 0.4, 0.6, 0.8)
    ]
    return small.clutter("ladder", *rails, *treads, cad.box(0.36, 0.16, 0.03).at(z=1.49))
