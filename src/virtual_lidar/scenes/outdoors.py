"""Models of airplanes, cars and trees.

Each public function makes one object of a class. The argument `member` is the number of the object
in the class, from 0, which selects the variant. Other choices are random.
"""

from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.bodies import Item
from virtual_lidar.scenes.furniture.plants import leaf
from virtual_lidar.scenes.furniture.small import clutter
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import (
    Outline,
    Point,
    Segment,
    arc,
    catmull_rom,
    curve,
    line,
    loop,
    point,
    rounded,
)
from virtual_lidar.scenes.solids import extrude, loft
from virtual_lidar.scenes.surfaces import Surface, frame_along, join


def airplane(cad: Modeller, member: int) -> Item:
    """Make an airliner, propeller plane or glider, its nose towards +x."""
    style = member % 4
    radius = (1.9, 1.7, 0.7, 0.5)[style] * cad.between(0.9, 1.1)
    length = (34.0, 40.0, 9.0, 8.0)[style] * cad.between(0.9, 1.1)
    span = (0.48, 0.5, 0.55, 1.05)[style] * length * cad.between(0.9, 1.1)
    sweep = (0.5, 0.55, 0.05, 0.02)[style]
    chord = length * (0.17, 0.18, 0.17, 0.1)[style]
    parts = [_fuselage(cad, radius, length)]
    low = -0.55 * radius if style < 2 else 0.75 * radius
    wing = _wing(cad, chord, chord * 0.35, span, sweep).at(x=length * 0.58, z=low)
    tail = _wing(cad, chord * 0.55, chord * 0.25, span * 0.36, sweep)
    fin = _wing(cad, chord * 0.7, chord * 0.3, span * 0.3 + radius, max(sweep, 0.3)).at(tilt=90)
    side = [wing, tail.at(x=length * 0.1, z=radius * 0.3)]
    for share in ((0.33,), (0.3, 0.58), (), ())[style]:
        x, y = length * 0.6 - sweep * span * share, span * share
        side.append(_nacelle(cad, radius * 0.55).at(x, y, low - radius * 0.6))
    half = join(side)
    parts += [half, half.mirrored(1), fin.at(x=length * 0.11)]
    if style == 2:
        parts += _propeller(cad, radius, length)
    return clutter("airplane", *parts)


def _fuselage(cad: Modeller, radius: float, length: float) -> Surface:
    radii = (0.0, 0.25, 0.7, 1.0, 1.0, 1.0, 0.75, 0.35, 0.0)
    stations = (0.0, 0.04, 0.16, 0.34, 0.6, 0.84, 0.94, 0.985, 1.0)
    shares = np.column_stack([radii, stations])
    smooth = catmull_rom(shares * (radius, length), max(4, cad.steps(1) // 12))
    smooth[:, 0] = np.maximum(smooth[:, 0], 0.0)
    return cad.turned((Segment("curve", smooth),)).at(roll=90)


def _wing(cad: Modeller, root: float, tip: float, span: float, sweep: float) -> Surface:
    angles = np.linspace(0, 2 * np.pi, max(16, cad.steps(1) // 2), endpoint=False)
    at = np.linspace(0, 1, max(6, round(12 * cad.detail)))
    chord = (root + (tip - root) * at) * np.append(np.ones(len(at) - 1), 0.8)
    thick = 0.12 * np.sin(angles) * (0.55 + 0.45 * np.cos(angles))
    sections = np.empty((len(at), len(angles), 3))
    sections[..., 0] = chord[:, None] * (np.cos(angles) / 2) - sweep * span * at[:, None]
    sections[..., 1] = span * at[:, None]
    sections[..., 2] = -chord[:, None] * thick + 0.06 * span * at[:, None]
    return loft(sections)


def _nacelle(cad: Modeller, radius: float) -> Surface:
    length = radius * 3.2
    back, rim, inner, depth = radius * 0.55, radius * 0.92, radius * 0.84, length * 0.75
    skin = curve([(back, 0), (radius * 0.9, length * 0.35), (radius, depth), (rim, length)], 6)
    intake = line((rim, length), (inner, length), (inner, depth), (0, depth))
    spinner = cad.cone(radius * 0.3, 0.0, length * 0.2).at(z=depth)
    pylon = cad.box(radius * 0.2, length * 0.6, radius * 1.2).at(turn=90)
    engine = cad.turned(line((0, 0), (back, 0)), skin, intake) + spinner
    return engine.at(roll=90) + pylon.at(x=length * 0.4, z=radius * 0.6)


def _propeller(cad: Modeller, radius: float, length: float) -> list[Surface]:
    hub = cad.superquadric((0.2, 0.2, 0.4)).at(x=length, roll=90)
    blade = cad.superquadric((0.04, 0.13, 0.85)).at(z=0.9, turn=25)
    blades = [blade.at(tilt=angle).at(x=length + 0.1) for angle in (0, 120, 240)]
    x, z = length * 0.62, -radius - 0.7
    wheels = cad.torus(0.28, 0.12).at_sides(x, 0.8, z, axis=1, tilt=90)
    struts = [cad.rod((x, s * 0.8, z), (x, s * 0.2, -radius * 0.8), 0.07) for s in (-1, 1)]
    return [hub, *blades, *wheels, *struts]


_CAR_SIDES = (
    ((-2.2, 0.35), (2.2, 0.35), (2.2, 0.75), (1.1, 0.92), (-1.5, 0.95), (-2.2, 0.9)),
    ((-1.9, 0.35), (1.9, 0.35), (1.9, 0.75), (1.05, 0.92), (-1.9, 0.98)),
    ((-2.3, 0.4), (2.3, 0.4), (2.3, 0.95), (1.7, 1.15), (-2.3, 1.15)),
    ((-2.5, 0.5), (2.4, 0.5), (2.4, 0.95), (1.3, 1.1), (-2.5, 1.1)),
)
_CAR_CABINS = (
    ((-1.55, 0.9), (1.15, 0.9), (0.45, 1.42), (-0.9, 1.42)),
    ((-1.85, 0.9), (1.1, 0.9), (0.4, 1.46), (-1.6, 1.46)),
    ((-2.25, 1.1), (1.75, 1.1), (1.2, 2.0), (-2.2, 2.0)),
    ((-0.5, 1.05), (1.3, 1.05), (0.75, 1.75), (-0.4, 1.75)),
)


def car(cad: Modeller, member: int) -> Item:
    """Make a saloon, hatchback, van or pick-up, facing +x."""
    style = member % 4
    stretch = cad.between(0.92, 1.08)
    width = cad.between(1.65, 1.85)
    steps = max(4, cad.steps(0.2) // 4)
    side, cabin = (
        [(x * stretch, z) for x, z in shapes[style]] for shapes in (_CAR_SIDES, _CAR_CABINS)
    )
    axles = (-side[1][0] * 0.62, side[1][0] * 0.64)
    body = extrude(_with_arches(cad, side, axles, 0.42, steps), width).at(y=width / 2, tilt=90)
    top = _tapered(rounded(cabin, 0.1, steps), width * 0.98, width * 0.8)
    wheels = [
        _wheel(cad).at(x, s * (width / 2 - 0.1), 0.33, turn=0 if s > 0 else 180)
        for x in axles
        for s in (-1, 1)
    ]
    front = side[2][0]
    lights = cad.superquadric((0.06, 0.17, 0.1)).at_sides(front - 0.01, width * 0.33, 0.66, axis=1)
    place = (cabin[1][0] - 0.35, width / 2 + 0.08, cabin[0][1] + 0.1)
    mirrors = cad.superquadric((0.06, 0.12, 0.08)).at_sides(*place, axis=1)
    bumpers, y = [], width / 2 - 0.05
    for x in (front, side[0][0]):
        corners = ((x * 0.97, -y), (x * 1.03, -y), (x * 1.03, y), (x * 0.97, y))
        bumpers.append(cad.pipe([(*corner, 0.45) for corner in corners], 0.05, 0.055))
    parts = [body, top, *wheels, *lights, *mirrors, *bumpers]
    if style == 3:
        back, board = side[0][0], cad.box(side[0][0] * -0.72, 0.06, 0.35)
        parts += board.at_sides(back * 0.62, width / 2 - 0.03, 1.08, axis=1)
        parts.append(cad.box(0.06, width, 0.35).at(back + 0.03, 0, 1.08))
    return clutter("car", *parts)


def _with_arches(
    cad: Modeller, side: list[Point], axles: tuple[float, float], radius: float, steps: int
) -> Outline:
    low = side[0][1]
    half = float(np.sqrt(radius**2 - (low - 0.33) ** 2))
    start, end = (float(np.degrees(np.arctan2(low - 0.33, x))) for x in (-half, half))
    cuts: list[Segment] = []
    x = side[0][0] + 0.09
    for axle in axles:
        cuts += line((x, low), (axle - half, low))
        cuts += arc((axle, 0.33), radius, start, end, cad.steps(radius) // 2)
        x = axle + half
    whole = rounded(side, 0.09, steps)
    corners = [segment for segment in whole if segment.kind == "arc"]
    cuts += line((x, low), point(corners[1].points[0]))
    first = line(point(whole[0].points[-1]), (side[0][0] + 0.09, low))
    return (whole[0], *first, *cuts, *whole[2:])


def _tapered(outline: Outline, low: float, high: float) -> Surface:
    points = loop(outline)
    foot, roof = points[:, 1].min(), points[:, 1].max()
    half = (low + (high - low) * (points[:, 1] - foot) / (roof - foot)) / 2
    sides = [np.column_stack([points[:, 0], s * half, points[:, 1]]) for s in (1, -1)]
    return loft(np.stack(sides))


def _wheel(cad: Modeller) -> Surface:
    tyre = cad.torus(0.24, 0.09).at(tilt=90)
    rim = cad.cylinder(0.19, 0.12).at(y=0.06, tilt=90)
    spoke = cad.box(0.035, 0.02, 0.17)
    spokes = [spoke.at(roll=angle).at(y=0.065) for angle in np.arange(0, 360, 60.0)]
    return join([tyre, rim, *spokes, cad.superquadric((0.05, 0.05, 0.03)).at(y=0.07, tilt=90)])


def tree(cad: Modeller, member: int) -> Item:
    """Make a conifer, deciduous tree, bare tree or palm."""
    return clutter("tree", *(_conifer, _leafy, _bare, _palm)[member % 4](cad))


def _conifer(cad: Modeller) -> list[Surface]:
    height, tiers = cad.between(3.0, 4.2), int(cad.rng.integers(4, 8))
    parts = [cad.cone(0.16, 0.1, height * 0.3)]
    for k in range(tiers):
        share = k / tiers
        radius = (1.15 - share) * cad.between(0.9, 1.1)
        wall = line((0, 0.1), (radius, 0), (0.03, height / tiers * 1.6), (0, height / tiers * 1.6))
        parts.append(cad.turned(wall).at(z=height * (0.2 + 0.75 * share), tilt=cad.between(-3, 3)))
    return parts


def _grow(
    cad: Modeller, start: Floats, heading: Floats, length: float, thick: float, depth: int
) -> tuple[list[Surface], list[Floats]]:
    middle = start + heading * length * 0.5 + cad.rng.normal(0, 0.05 * length, 3)
    end = start + heading * length
    path = cad.smooth([start.tolist(), middle.tolist(), end.tolist()], 4)
    parts = [cad.tube(path, np.linspace(thick, thick * 0.68, len(path)))]
    if depth == 0:
        return parts, [end]
    tips: list[Floats] = []
    count = int(cad.rng.integers(2, 4))
    for k in range(count):
        turn = 2 * np.pi * k / count + cad.between(0, 1)
        across = frame_along(heading, end)[:3, :2] @ [np.cos(turn), np.sin(turn)]
        towards = heading + across * cad.between(0.5, 0.9) + (0.0, 0.0, 0.12)
        towards /= np.linalg.norm(towards)
        fork, reach = end - heading * thick * 0.3, length * cad.between(0.62, 0.8)
        more, ends = _grow(cad, fork, towards, reach, thick * 0.66, depth - 1)
        parts += more
        tips += ends
    return parts, tips


def _leafy(cad: Modeller) -> list[Surface]:
    parts, tips = _grow(cad, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.3, 0.14, 2)
    for tip in tips:
        size = cad.between(0.38, 0.6)
        crown = cad.superquadric((size, size * 0.9, size * 0.75))
        parts.append(crown.at(*tip, turn=cad.between(0, 90)))
    return parts


def _bare(cad: Modeller) -> list[Surface]:
    return _grow(cad, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.2, 0.13, 4)[0]


def _palm(cad: Modeller) -> list[Surface]:
    lean = cad.between(-0.5, 0.5)
    path = cad.smooth([(0, 0, 0), (lean * 0.2, 0, 0.9), (lean * 0.6, 0, 1.9), (lean, 0, 2.7)], 12)
    rings = 0.13 - 0.04 * np.linspace(0, 1, len(path)) + 0.012 * (np.arange(len(path)) % 3 == 0)
    top = path[-1]
    parts = [cad.tube(path, rings)]
    for k in range(int(cad.rng.integers(11, 17))):
        frond = leaf(cad, cad.between(1.2, 1.7), 0.32, cad.between(0.3, 0.8))
        parts.append(frond.at(*top, turn=137.5 * k, roll=-cad.between(-10, 35)))
    parts += [
        cad.sphere(0.1).at(top[0] + 0.12 * np.cos(t), top[1] + 0.12 * np.sin(t), top[2] - 0.1)
        for t in (0.0, 2.1, 4.2)
    ]
    return parts
