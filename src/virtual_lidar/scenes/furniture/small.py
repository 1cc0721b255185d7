from __future__ import annotations

import numpy as np

from virtual_lidar.scenes.bodies import Body, Item, moved, posed
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import Point, arc, curve, line, polar, polygon
from virtual_lidar.scenes.solids import extrude
from virtual_lidar.scenes.surfaces import Surface, join, pose

BOTTLES: tuple[tuple[Point, ...], ...] = (
    ((0.036, 0.0), (0.037, 0.1), (0.036, 0.17), (0.016, 0.22), (0.013, 0.27)),
    ((0.03, 0.0), (0.033, 0.03), (0.029, 0.08), (0.033, 0.13), (0.014, 0.18), (0.012, 0.2)),
    ((0.045, 0.0), (0.046, 0.12), (0.04, 0.19), (0.02, 0.22), (0.018, 0.25)),
)


def clutter(kind: str, *parts: Surface) -> Item:
    return [Body(kind, "clutter", join(list(parts)))]


def monitor(cad: Modeller) -> Item:
    width = cad.between(0.48, 0.62)
    height, lift = width * 0.58, 0.12
    frame = cad.slab(width, height, 0.03, 0.01).at(y=0.015, z=lift + height / 2, tilt=90)
    screen = cad.box(width - 0.03, 0.004, height - 0.03).at(y=-0.016, z=lift + 0.015)
    foot = cad.slab(0.24, 0.18, 0.012, 0.05).at(y=0.03)
    stem = cad.cylinder(0.02, lift + 0.08).at(y=0.045, z=0.01)
    return clutter("monitor", frame, screen, foot, stem)


def keyboard(cad: Modeller) -> Item:
    board = cad.slab(0.44, 0.14, 0.015, 0.01)
    keys = [
        cad.box(0.016, 0.016, 0.006).at(x, y, 0.015)
        for y in np.linspace(-0.055, 0.055, 6)
        for x in np.linspace(-0.205, 0.205, 21)
    ]
    return clutter("keyboard", board, *keys)


def mouse(cad: Modeller) -> Item:
    return clutter("mouse", cad.superquadric((0.032, 0.055, 0.018), (0.7, 0.8)).at(z=0.018))


def laptop(cad: Modeller) -> Item:
    base = cad.slab(0.33, 0.23, 0.016, 0.012)
    lid = cad.slab(0.33, 0.22, 0.008, 0.012).at(y=-0.11).at(y=0.115, z=0.014, tilt=-75)
    keys = [
        cad.box(0.017, 0.015, 0.003).at(x, y, 0.016)
        for y in np.linspace(-0.01, 0.08, 5)
        for x in np.linspace(-0.135, 0.135, 14)
    ]
    return clutter("laptop", base, lid, *keys, cad.box(0.1, 0.06, 0.002).at(y=-0.07, z=0.016))


def mug(cad: Modeller) -> Item:
    radius, height = cad.between(0.036, 0.043), cad.between(0.085, 0.1)
    inner = radius - 0.004
    outside, inside = ((radius, 0), (radius, height)), ((inner, height), (inner, 0.006))
    outline = line((0, 0), *outside, *inside, (0, 0.006))
    section = arc((0.026, 0), 0.005, 0, 360, cad.steps(0.01))
    handle = cad.turned(section, degrees=180).at(turn=-90)
    handle = handle.at(radius - 0.001, 0, height / 2, tilt=90)
    return clutter("mug", cad.turned(outline), handle)


def bottle(cad: Modeller) -> Item:
    profile = cad.pick(BOTTLES)
    radius, top = profile[-1]
    side = curve(profile, max(3, cad.steps(0.1) // 8))
    body = cad.turned(line((0, 0), profile[0]), side, line((radius, top), (0, top)))
    return clutter("bottle", body, cad.cylinder(radius + 0.003, 0.018).at(z=top - 0.002))


def book(cad: Modeller, height: float = 0.24, thickness: float = 0.03) -> Item:
    width = height * 0.72
    boards = [cad.box(width, height, 0.003).at(z=z) for z in (0.0, thickness - 0.003)]
    pages = cad.box(width - 0.008, height - 0.01, thickness - 0.006).at(x=0.001, z=0.003)
    back = arc((0, 0), thickness / 2, 90, 270, max(4, cad.steps(0.01) // 2))
    half = extrude((*back, *line((0, -thickness / 2), (0, thickness / 2))), height)
    spine = half.at(-width / 2 + 0.002, height / 2, thickness / 2, tilt=90)
    return clutter("book", *boards, pages, spine)


def standing_book(cad: Modeller, height: float, thickness: float) -> Item:
    """Make an upright book, spine to the front, thickness along x."""
    upright = pose(thickness / 2, 0, height / 2, turn=90) @ pose(tilt=90)
    return posed(book(cad, height, thickness), upright)


def books(cad: Modeller) -> Item:
    item: Item = []
    z = 0.0
    for _ in range(int(cad.rng.integers(2, 5))):
        thickness = cad.between(0.015, 0.045)
        volume = book(cad, cad.between(0.2, 0.28), thickness)
        item += moved(volume, 0, 0, z, turn=cad.between(-25, 25))
        z += thickness
    return item


def papers(cad: Modeller) -> Item:
    sheet, count = cad.box(0.21, 0.297, 0.006), int(cad.rng.integers(2, 6))
    sheets = [sheet.at(z=0.006 * k, turn=cad.between(-4, 4)) for k in range(count)]
    return clutter("papers", *sheets)


def carton(cad: Modeller, size: float = 0.4) -> Item:
    x, y, z = (size * cad.between(0.6, 1.0) for _ in range(3))
    flaps = cad.box(x, y / 2 - 0.002, 0.004).at_sides(y=y / 4 + 0.001, z=z, axis=1)
    tape = cad.box(x * 0.9, 0.05, 0.001).at(z=z + 0.004)
    return clutter("box", cad.box(x, y, z), *flaps, tape)


def carton_stack(cad: Modeller) -> Item:
    item: Item = []
    z = 0.0
    for size in np.sort([cad.between(0.3, 0.6) for _ in range(int(cad.rng.integers(2, 5)))])[::-1]:
        box = carton(cad, float(size))
        item += moved(box, 0, 0, z, turn=cad.between(-12, 12))
        z += float(box[0].surface.bounds()[1, 2])
    return item


def ball(cad: Modeller, radius: float | None = None) -> Item:
    size = cad.between(0.05, 0.14) if radius is None else radius
    return clutter("ball", cad.sphere(size).at(z=size))


def waste_bin(cad: Modeller) -> Item:
    low, high, height = 0.1, cad.between(0.13, 0.16), cad.between(0.28, 0.4)
    wall = 0.004
    profile = line(
        (0, 0), (low, 0), (high, height), (high - wall, height), (low - wall, wall), (0, wall)
    )
    return clutter("bin", cad.turned(profile), cad.torus(high, 0.006).at(z=height))


def desk_lamp(cad: Modeller) -> Item:
    rise, reach = cad.between(0.24, 0.34), cad.between(0.08, 0.15)
    elbow, head = (0.0, reach, rise), (0.0, -reach, rise + cad.between(0.1, 0.2))
    foot = cad.cylinder(cad.between(0.07, 0.09), 0.02)
    arms = [cad.rod((0, 0, 0.01), elbow, 0.008), cad.rod(elbow, head, 0.008)]
    joints = [cad.sphere(0.014).at(*point) for point in (elbow, head)]
    shade = line(
        (0.0, 0.066), (0.027, 0.066), (0.072, -0.05), (0.075, -0.05), (0.03, 0.07), (0.0, 0.07)
    )
    cover = cad.turned(shade).at(0, -0.03, -0.03, tilt=-25).at(*head)
    bulb = cad.sphere(0.025).at(0, -0.03, -0.04).at(*head)
    return clutter("desk_lamp", foot, *arms, *joints, cover, bulb)


def telephone(cad: Modeller) -> Item:
    wedge = extrude(polygon((-0.1, 0.0), (0.1, 0.0), (0.1, 0.07), (-0.1, 0.02)), 0.17)
    body = wedge.at(y=0.085, tilt=90).at(turn=90)
    keys = [
        cad.box(0.014, 0.014, 0.008).at(0.02 + 0.022 * i, -0.06 + 0.03 * j, 0.036 + 0.0075 * j)
        for i in range(3)
        for j in range(4)
    ]
    handset = cad.rod((-0.05, -0.1, 0.062), (-0.05, 0.1, 0.112), 0.018)
    ears = [cad.cylinder(0.027, 0.035).at(-0.05, y, 0.04 + 0.25 * y) for y in (-0.075, 0.075)]
    return clutter("telephone", body, *keys, handset, *ears)


def vase(cad: Modeller) -> Item:
    a, b = cad.between(0.05, 0.09), cad.between(0.03, 0.05)
    outside = ((0.04, 0.0), (a, 0.1), (b, 0.22), (b + 0.02, 0.27))
    return clutter("vase", cad.vessel(outside, 0.005))


def bowl(cad: Modeller) -> Item:
    dish = cad.vessel(((0.05, 0.0), (0.1, 0.03), (0.14, 0.08)), 0.006)
    spots = polar(0.05, np.radians((0, 120, 240)))
    return clutter("bowl", dish, *(cad.sphere(0.038).at(x, y, 0.055) for x, y in spots))


def bucket(cad: Modeller) -> Item:
    profile = line((0, 0), (0.11, 0), (0.15, 0.28), (0.145, 0.28), (0.106, 0.005), (0, 0.005))
    angles = np.linspace(0, np.pi, max(9, cad.steps(0.15) // 2))
    cosine, sine = np.cos(angles), np.sin(angles)
    bail = np.column_stack([0.15 * cosine, 0.06 * sine, 0.26 + 0.12 * sine])
    return clutter("bucket", cad.turned(profile), cad.tube(bail, 0.004))


def printer(cad: Modeller) -> Item:
    tray = cad.box(0.24, 0.14, 0.01).at(y=-0.22, z=0.07)
    feeder = cad.box(0.22, 0.012, 0.16).at(y=0.14, z=0.2, tilt=-20)
    return clutter("printer", cad.cushion(0.42, 0.36, 0.22, 0.15), tray, feeder)


def microwave(cad: Modeller) -> Item:
    body = cad.box(0.48, 0.36, 0.28).at(z=0.012)
    feet = cad.cylinder(0.015, 0.013).at_corners(0.2, 0.14)
    door = cad.slab(0.34, 0.24, 0.012, 0.02).at(-0.05, -0.18, 0.15, tilt=90)
    knobs = [cad.cylinder(0.02, 0.02).at(0.18, -0.18, z, tilt=90) for z in (0.1, 0.18)]
    handle = cad.rod((0.1, -0.21, 0.06), (0.1, -0.21, 0.24), 0.008)
    return clutter("microwave", body, *feet, door, *knobs, handle)
