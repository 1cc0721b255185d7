"""Models of fixtures on walls and ceilings.

Wall fixtures have their back at y = 0 above a floor at z = 0; ceiling fixtures hang from z = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from virtual_lidar.scenes.bodies import Body, Item
from virtual_lidar.scenes.furniture.small import clutter
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import arc, line
from virtual_lidar.scenes.surfaces import Surface, join


def panel_lamp(cad: Modeller) -> Item:
    frame = cad.box(0.6, 0.04, 0.05).at_sides(y=0.28, z=-0.05, axis=1)
    frame += cad.box(0.04, 0.52, 0.05).at_sides(0.28, z=-0.05)
    return clutter("panel_lamp", *frame, cad.box(0.52, 0.52, 0.03).at(z=-0.035))


def tube_lamp(cad: Modeller) -> Item:
    tray = cad.box(1.25, 0.16, 0.05).at(z=-0.05)
    tubes = [cad.rod((-0.58, y, -0.07), (0.58, y, -0.07), 0.013) for y in (-0.04, 0.04)]
    ends = cad.box(0.03, 0.12, 0.045).at_sides(0.595, z=-0.09)
    return clutter("tube_lamp", tray, *tubes, *ends)


def pendant_lamp(cad: Modeller) -> Item:
    drop = cad.between(0.5, 0.7)
    cord = cad.rod((0, 0, -drop), (0, 0, -0.02), 0.004)
    rose = cad.cone(0.03, 0.06, 0.03).at(z=-0.03)
    if cad.chance(0.5):
        return clutter("pendant_lamp", cord, rose, cad.sphere(0.15).at(z=-drop - 0.13))
    shade = line((0, 0.116), (0.036, 0.116), (0.197, -0.1), (0.2, -0.1), (0.04, 0.12), (0, 0.12))
    bulb = cad.sphere(0.04).at(z=-drop - 0.06)
    return clutter("pendant_lamp", cord, rose, cad.turned(shade).at(z=-drop - 0.1), bulb)


def smoke_detector(cad: Modeller) -> Item:
    return clutter("detector", cad.cone(0.035, 0.055, 0.045).at(z=-0.045))


def projector(cad: Modeller) -> Item:
    rod = cad.cylinder(0.02, 0.3).at(z=-0.3)
    body = cad.cushion(0.36, 0.28, 0.12, 0.2).at(z=-0.42)
    return clutter("projector", rod, body, cad.cylinder(0.04, 0.06).at(0.08, -0.13, -0.36, tilt=90))


def ceiling_diffuser(cad: Modeller) -> Item:
    rings = [cad.torus(radius, 0.012).at(z=-0.012) for radius in (0.07, 0.13, 0.19)]
    return clutter("vent", cad.cone(0.03, 0.05, 0.02).at(z=-0.02), *rings)


def duct(cad: Modeller, length: float, *, round_: bool = True) -> Item:
    radius, z = 0.16, -0.3
    places = np.arange(-length / 2 + 0.5, length / 2, 1.2)
    if round_:
        body = cad.rod((-length / 2, 0, z), (length / 2, 0, z), radius)
        flanges = [cad.rod((x - 0.02, 0, z), (x + 0.02, 0, z), radius + 0.012) for x in places]
    else:
        body = cad.box(length, 0.45, 0.25).at(z=z - 0.125)
        flanges = [cad.box(0.04, 0.5, 0.3).at(x=x, z=z - 0.15) for x in places]
    hangers = [cad.rod((x, 0, z + 0.1), (x, 0, 0), 0.006) for x in places]
    return clutter("duct", body, *flanges, *hangers)


def pipe_run(cad: Modeller, points: Sequence[Sequence[float]], radius: float = 0.03) -> Item:
    path = np.array(points, dtype=np.float64)
    clamps = []
    for start, end in pairwise(path):
        middle, along = (start + end) / 2, (end - start) / np.linalg.norm(end - start)
        clamps.append(cad.rod(middle - 0.02 * along, middle + 0.02 * along, radius * 1.35))
    return clutter("pipe", cad.pipe(path.tolist(), radius, radius * 3), *clamps)


def radiator(cad: Modeller, width: float = 1.0) -> Item:
    count = int(width / 0.075)
    xs = (np.arange(count) - (count - 1) / 2) * 0.075
    ribs = [cad.slab(0.05, 0.1, 0.5, 0.022).at(float(x), -0.1, 0.14) for x in xs]
    bars = [cad.rod((xs[0], -0.1, z), (xs[-1], -0.1, z), 0.022) for z in (0.19, 0.59)]
    end = float(xs[-1]) + 0.03
    path = [(end - 0.02, -0.1, 0.59), (end + 0.07, -0.1, 0.59), (end + 0.07, -0.1, 0.0)]
    feed = cad.pipe(path, 0.01, 0.03)
    knob = cad.cone(0.022, 0.016, 0.06).at(end + 0.03, -0.1, 0.59, roll=90)
    stays = [cad.rod((x, -0.1, 0.3), (x, 0, 0.3), 0.008) for x in (xs[1], xs[-2])]
    return clutter("radiator", *ribs, *bars, feed, knob, *stays)


def whiteboard(cad: Modeller, width: float = 2.0) -> Item:
    height, low = 1.1, 0.9
    panel = cad.box(width, 0.02, height).at(y=-0.01, z=low)
    bar = cad.box(width + 0.04, 0.03, 0.025).at(y=-0.015)
    bars = [bar.at(z=z) for z in (low - 0.02, low + height)]
    bars += cad.box(0.02, 0.03, height).at_sides(width / 2 + 0.01, -0.015, low)
    tray = cad.box(width * 0.5, 0.08, 0.015).at(y=-0.06, z=low - 0.03)
    z = low - 0.005
    pens = [cad.rod((x, -0.07, z), (x + 0.12, -0.06, z), 0.009) for x in (-0.3, -0.1, 0.15)]
    return [Body("whiteboard", "board", join([panel, *bars, tray, *pens]))]


def pinboard(cad: Modeller) -> Item:
    width, height, low = cad.between(0.8, 1.2), 0.8, 1.1
    panel = cad.box(width, 0.02, height).at(y=-0.01, z=low)
    sheets = [
        cad.box(0.15, 0.003, 0.21).at(x, -0.022, low + z, roll=cad.between(-6, 6))
        for x in np.arange(-width / 2 + 0.14, width / 2 - 0.1, 0.2)
        for z in (0.08, 0.45)
        if cad.chance(0.8)
    ]
    return [Body("pinboard", "board", join([panel, *sheets]))]


def picture(cad: Modeller) -> Item:
    width, height = cad.between(0.4, 0.9), cad.between(0.4, 0.7)
    z = 1.55 - height / 2
    bars = [cad.box(width, 0.03, 0.03).at(y=-0.015, z=at) for at in (z, z + height - 0.03)]
    bars += cad.box(0.03, 0.03, height).at_sides(width / 2 - 0.015, -0.015, z)
    canvas = cad.box(width - 0.04, 0.012, height - 0.04).at(y=-0.006, z=z + 0.02)
    return clutter("picture", *bars, canvas)


def clock(cad: Modeller) -> Item:
    face = cad.cylinder(0.15, 0.03).at(z=2.1, tilt=90)
    rim = cad.torus(0.15, 0.012).at(y=-0.03, z=2.1, tilt=90)
    hands = [
        cad.box(0.012, 0.004, length).at(y=-0.034, z=2.1, roll=turn)
        for length, turn in ((0.11, 60), (0.08, -50))
    ]
    return clutter("clock", face, rim, *hands)


def extinguisher(cad: Modeller) -> Item:
    radius, steps = 0.075, cad.steps(0.075) // 4
    side, shoulder = line((0, 0), (radius, 0), (radius, 0.4)), arc((0.025, 0.4), 0.05, 0, 90, steps)
    bottle = cad.turned(side, shoulder, line((0.025, 0.45), (0.02, 0.5), (0, 0.5)))
    path = [(0, 0, 0.48), (0.09, -0.02, 0.46), (0.11, -0.02, 0.25), (0.1, -0.03, 0.1)]
    hose = cad.tube(cad.smooth(path), 0.01)
    lever = cad.box(0.02, 0.14, 0.02).at(y=-0.05, z=0.5, tilt=10)
    bracket = cad.box(0.06, 0.03, 0.2).at(y=-0.015, z=0.9)
    return clutter("extinguisher", (bottle + hose + lever).at(y=-0.09, z=0.75), bracket)


def coat_rack(cad: Modeller) -> Item:
    hooks = []
    for x in np.linspace(-0.4, 0.4, 5):
        path = cad.smooth([(x, -0.02, 1.7), (x, -0.09, 1.66), (x, -0.12, 1.7), (x, -0.11, 1.74)], 5)
        hooks += [cad.tube(path, 0.007), cad.sphere(0.014).at(*path[-1])]
    return clutter("coat_rack", cad.box(1.0, 0.02, 0.1).at(y=-0.01, z=1.66), *hooks)


def wall_shelf(cad: Modeller) -> Item:
    board = cad.box(0.9, 0.22, 0.02).at(y=-0.11, z=1.6)
    arms = [cad.rod((x, -0.19, 1.595), (x, -0.005, 1.44), 0.008) for x in (-0.3, 0.3)]
    balls = [cad.sphere(0.07).at(-0.25, -0.11, 1.69), cad.cone(0.07, 0.0, 0.2).at(0.0, -0.11, 1.62)]
    can = cad.cylinder(0.05, 0.18).at(0.25, -0.11, 1.62)
    return clutter("wall_shelf", board, *arms, *balls, can)


def projection_screen(cad: Modeller, width: float = 3.0) -> Item:
    case = cad.rod((-width / 2, -0.1, 2.6), (width / 2, -0.1, 2.6), 0.06)
    cloth = cad.box(width - 0.1, 0.006, 1.7).at(y=-0.1, z=0.9)
    bar = cad.rod((-width / 2 + 0.04, -0.1, 0.89), (width / 2 - 0.04, -0.1, 0.89), 0.015)
    return [Body("screen", "board", join([case, cloth, bar]))]


def light_switch(cad: Modeller) -> Item:
    plate = cad.box(0.08, 0.01, 0.08).at(y=-0.005, z=1.05)
    return clutter("switch", plate, cad.box(0.04, 0.008, 0.05).at(y=-0.012, z=1.065))


def round_column(cad: Modeller, height: float, radius: float = 0.22) -> Item:
    ring = cad.torus(radius, 0.035).at(z=0.035)
    return [Body("column", "column", cad.cylinder(radius, height) + ring)]


def square_column(cad: Modeller, height: float, size: float = 0.4) -> Item:
    shaft, base = cad.box(size, size, height), cad.box(size + 0.04, size + 0.04, 0.1)
    return [Body("column", "column", shaft + base)]


def beam(cad: Modeller, length: float, depth: float = 0.3) -> Item:
    return [Body("beam", "beam", cad.box(length, 0.25, depth).at(z=-depth))]


def plinth(cad: Modeller) -> Item:
    height = cad.between(0.6, 0.95)
    bodies: tuple[Callable[[], Surface], ...] = (
        lambda: cad.sphere(0.22).at(z=0.22),
        lambda: cad.torus(0.2, 0.07).at(z=0.27, tilt=90),
        lambda: cad.cone(0.2, 0.0, 0.5),
        lambda: cad.superquadric((0.22, 0.22, 0.25), (0.4, 0.4)).at(z=0.25),
        lambda: cad.superquadric((0.22, 0.18, 0.28), (1.8, 1.8)).at(z=0.28),
        lambda: cad.superquadric((0.2, 0.14, 0.3), (1.0, 1.0)).at(z=0.3),
        lambda: cad.cylinder(0.16, 0.4),
        lambda: cad.superquadric((0.2, 0.2, 0.25), (0.3, 1.0)).at(z=0.25),
    )
    body = cad.pick(bodies)().at(z=height, turn=cad.between(0, 360))
    base = cad.pick((cad.box(0.5, 0.5, height), cad.cylinder(0.27, height)))
    return [Body("plinth", "clutter", base), Body("sculpture", "clutter", body)]
