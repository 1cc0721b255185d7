"""Models of objects in a house: chairs, tables, lamps, vessels, spectacles and guitars.

Each public function makes one object of a class. The argument `member` is the number of the object
in the class, from 0, which selects the variant. Other choices are random.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.bodies import Body, Item
from virtual_lidar.scenes.furniture import fixtures, seating, small, tables
from virtual_lidar.scenes.furniture.small import clutter
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import (
    Point,
    arc,
    catmull_rom,
    circle,
    closed_curve,
    curve,
    line,
    point,
    polar,
)
from virtual_lidar.scenes.solids import extrude
from virtual_lidar.scenes.surfaces import Surface, join


def chair(cad: Modeller, member: int) -> Item:
    """Make an office chair, plain chair, moulded chair, stool, armchair or auditorium seat."""
    chairs = (seating.office_chair, seating.chair, seating.shell_chair, seating.stool)
    makers = (*chairs, partial(seating.sofa, seats=1), seating.auditorium_seat)
    return makers[member % len(makers)](cad)


def table(cad: Modeller, member: int) -> Item:
    """Make a round table, coffee table, meeting table, workbench, desk or trestle table."""
    makers = (_round, tables.coffee_table, _meeting, tables.workbench, tables.desk, _trestle)
    return makers[member % len(makers)](cad)[:1]


def _round(cad: Modeller) -> Item:
    return tables.round_table(cad, cad.between(0.35, 0.7), cad.between(0.5, 1.05))


def _meeting(cad: Modeller) -> Item:
    return tables.meeting_table(cad, cad.between(1.8, 3.4), cad.between(0.9, 1.4))


def _trestle(cad: Modeller) -> Item:
    width, height = cad.between(1.4, 2.0), cad.between(0.7, 0.8)
    top = cad.slab(width, 0.75, 0.03, 0.12).at(z=height)
    x = width * 0.34
    legs = cad.legs((x, 0.32), (x, 0.08), height, 0.022)
    bars = [cad.rod((a, -0.24, 0.22), (a, 0.24, 0.22), 0.015) for a in (-x, x)]
    beam = cad.rod((-x, 0, 0.22), (x, 0, 0.22), 0.018)
    return [Body("trestle_table", "table", join([top, *legs, *bars, beam]))]


def lamp(cad: Modeller, member: int) -> Item:
    """Make a desk lamp, pendant, floor lamp, table lamp, arc lamp or lantern."""
    makers = (small.desk_lamp, fixtures.pendant_lamp, _floor_lamp, _table_lamp, _arc_lamp, _lantern)
    return makers[member % len(makers)](cad)


def _open_shade(cad: Modeller, low: float, high: float, height: float) -> Surface:
    wall = 0.004
    ring = line((low, 0), (high, height), (high - wall, height), (low - wall, 0), (low, 0))
    return cad.turned(ring)


def _floor_lamp(cad: Modeller) -> Item:
    height = cad.between(1.3, 1.6)
    edge = arc((0.13, 0.0), 0.02, 0, 90, 6)
    foot = cad.turned(line((0, 0), (0.15, 0)), edge, line((0.13, 0.02), (0.0, 0.03)))
    shade = _open_shade(cad, cad.between(0.18, 0.24), cad.between(0.1, 0.17), 0.26).at(z=height)
    ends = polar(0.17, np.radians((0, 120, 240)))
    spokes = [cad.rod((0, 0, height + 0.05), (x, y, height + 0.05), 0.004) for x, y in ends]
    post, bulb = cad.cylinder(0.013, height + 0.06), cad.sphere(0.04).at(z=height + 0.1)
    return clutter("floor_lamp", foot, post, shade, *spokes, bulb)


def _table_lamp(cad: Modeller) -> Item:
    a, b = cad.between(0.07, 0.12), cad.between(0.03, 0.06)
    side = curve([(0.08, 0), (a, 0.08), (b, 0.2), (0.02, 0.28)], 10)
    body = cad.turned(line((0, 0), (0.08, 0)), side, line((0.02, 0.28), (0, 0.28)))
    shade = _open_shade(cad, 0.17, cad.between(0.08, 0.17), 0.2).at(z=0.27)
    bar = cad.rod((-0.165, 0, 0.3), (0.165, 0, 0.3), 0.004)
    post, bulb = cad.cylinder(0.006, 0.1).at(z=0.27), cad.sphere(0.035).at(z=0.38)
    return clutter("table_lamp", body, shade, bar, post, bulb)


def _arc_lamp(cad: Modeller) -> Item:
    path = cad.smooth([(0, 0, 0.02), (0, 0, 0.9), (0.25, 0, 1.6), (0.75, 0, 1.75), (1.05, 0, 1.4)])
    globe = cad.sphere(cad.between(0.14, 0.2)).at(1.07, 0, 1.25)
    return clutter("arc_lamp", cad.cylinder(0.17, 0.04), cad.tube(path, 0.014), globe)


def _lantern(cad: Modeller) -> Item:
    high, wide = cad.between(0.13, 0.2), cad.between(0.05, 0.068)
    foot = line((0, 0), (0.09, 0), (0.09, 0.03), (0.06, 0.05), (0, 0.05))
    glass = cad.superquadric((wide, wide, high / 2), (0.7, 1.0)).at(z=0.045 + high / 2)
    roof = cad.cone(0.09, 0.03, 0.06).at(z=0.045 + high)
    post = cad.cylinder(0.005, high + 0.03).at(x=0.08, z=0.02)
    ring = cad.torus(0.03, 0.005).at(z=0.13 + high, tilt=90)
    posts = [post.at(turn=90.0 * k) for k in range(4)]
    return clutter("lantern", cad.turned(foot), glass, roof, *posts, ring)


def bottle(cad: Modeller, member: int) -> Item:
    """Make a wine bottle, beer bottle, jar, canister or spray bottle."""
    neck, body = cad.between(0.012, 0.018), cad.between(0.034, 0.05)
    waist = body * cad.between(0.75, 1.0)
    spans = ((0.12, 0.17), (0.2, 0.23), (0.27, 0.31))
    shoulder, throat, rim = (cad.between(*span) for span in spans)
    radii = [body * 0.92, body, waist, body, neck * 1.3, neck, neck]
    heights = [0.0, 0.02, 0.08, shoulder, throat, 0.25, rim]
    if member % 3 == 2:
        radii = [body, body * 1.05, body, body * 0.8, body * 0.78]
        heights = [0.0, 0.05, 0.11, 0.13, 0.15]
    points = list(zip(radii, heights, strict=True))
    top = points[-1]
    parts = [cad.vessel(points, 0.003), cad.torus(top[0], 0.0025).at(z=top[1] - 0.012)]
    if member % 3 != 1:
        parts.append(cad.cylinder(top[0] + 0.003, 0.025).at(z=top[1] - 0.006))
    if member % 4 == 3:
        high, out = top[1] * 0.62, body + 0.035
        low, upper = (_radius(points, z) - 0.003 for z in (0.04, high))
        parts.append(_ear(cad, (low, out, out, upper), (0.04, 0.055, high - 0.02, high), 0.007))
    return clutter("bottle", *parts)


def _ear(cad: Modeller, xs: Sequence[float], zs: Sequence[float], radius: float) -> Surface:
    path = [(x, 0.0, z) for x, z in zip(xs, zs, strict=True)]
    return cad.tube(cad.smooth(path), radius)


def cup(cad: Modeller, member: int) -> Item:
    """Make a cup with a handle: straight, tapered or bulbous. Some variants have a saucer."""
    low, rim, height = (cad.between(0.025, 0.038), cad.between(0.036, 0.05), cad.between(0.06, 0.1))
    belly = max(low, rim) * cad.between(0.95, 1.15)
    shapes: tuple[list[Point], ...] = (
        [(rim, 0.0), (rim, height * 0.5), (rim, height)],
        [(low, 0.0), ((low + rim) / 2, height * 0.5), (rim, height)],
        [(low, 0.0), (belly, height * 0.35), (belly, height * 0.6), (rim, height)],
    )
    points = shapes[member % 3]
    upper, lower = (_radius(points, share * height) - 0.002 for share in (0.82, 0.25))
    out = max(upper, lower) + cad.between(0.02, 0.032)
    xs = (upper, upper + 0.7 * (out - upper), out, lower + 0.6 * (out - lower), lower)
    zs = [height * share for share in (0.82, 0.87, 0.55, 0.27, 0.25)]
    parts = [cad.vessel(points, 0.003), _ear(cad, xs, zs, 0.0045)]
    if member % 2:
        plate = cad.vessel([(0.03, 0.0), (0.05, 0.004), (0.075, 0.014)], 0.0025)
        parts = [plate, *(part.at(z=0.0025) for part in parts)]
    return clutter("cup", *parts)


def _radius(points: list[Point], height: float) -> float:
    smooth = catmull_rom(np.array(points), 8)
    return float(np.interp(height, smooth[:, 1], smooth[:, 0]))


def vase(cad: Modeller, member: int) -> Item:
    """Make a plain, fluted, twisted or two-handled vase."""
    heights = (0.0, 0.08, 0.18, 0.26, 0.32)
    spans = ((0.04, 0.06), (0.07, 0.12), (0.06, 0.12), (0.025, 0.05), (0.04, 0.08))
    radii = [cad.between(*span) for span in spans]
    body = cad.vessel(list(zip(radii, heights, strict=True)), 0.005)
    style = member % 4
    if style in (1, 2):
        waves, twist = int(cad.rng.integers(5, 12)), (8.0 if style == 2 else 0.0)
        body = body.deformed(lambda points: _fluted(points, waves, twist))
    if style == 3:
        x = radii[3]
        xs = (x * 0.9, x + 0.05, x + 0.055, radii[2] * 0.93)
        handle = _ear(cad, xs, (0.285, 0.28, 0.22, 0.19), 0.006)
        body = join([body, handle, handle.mirrored()])
    return clutter("vase", body)


def _fluted(points: Floats, waves: int, twist: float) -> Floats:
    angle = np.arctan2(points[:, 1], points[:, 0]) * waves + twist * points[:, 2] / 0.32
    swell = 1 + 0.06 * np.cos(angle)
    return points * np.column_stack([swell, swell, np.ones(len(points))])


def guitar(cad: Modeller, member: int) -> Item:
    electric = member % 2 == 1
    spans = ((0.18, 0.21), (0.11, 0.13), (0.13, 0.155))
    lower, waist, upper = (cad.between(*span) for span in spans)
    xs = (0.0, lower * 0.7, lower, waist, upper, upper * 0.7)
    half = list(zip(xs, (-0.26, -0.23, -0.1, 0.06, 0.17, 0.24), strict=True))
    half += [(0.09, 0.3), (0.035, 0.2)] if electric else [(0.04, 0.255)]
    ring = [*half, *((-x, y) for x, y in half[:0:-1])]
    depth = 0.045 if electric else 0.1
    steps = max(4, cad.steps(0.1) // 6)
    hole = [] if electric else [circle(0.05, cad.steps(0.05), (0.0, 0.08))]
    body = extrude(closed_curve(ring, steps), depth, hole)
    parts = [body, *_neck(cad, depth), cad.slab(0.14, 0.03, 0.012, 0.01).at(y=-0.12, z=depth)]
    if electric:
        parts += [cad.slab(0.09, 0.035, 0.01, 0.012).at(y=y, z=depth) for y in (-0.03, 0.08)]
        parts += [cad.cylinder(0.012, 0.015).at(0.12, y, depth) for y in (-0.12, -0.17)]
    else:
        parts.append(cad.torus(0.055, 0.004).at(y=0.08, z=depth))
    return clutter("guitar", *parts)


def _neck(cad: Modeller, depth: float) -> list[Surface]:
    back = arc((0, 0), 0.026, 180, 360, cad.steps(0.03) // 2)
    half = extrude((*back, *line((0.026, 0), (-0.026, 0))), 0.5)
    parts = [half.at(tilt=90).at(y=0.68, z=depth + 0.012)]
    frets = 0.68 - 0.62 * (1 - 2 ** (-np.arange(1, 18) / 12))
    parts += [cad.box(0.05, 0.002, 0.003).at(y=float(y), z=depth + 0.011) for y in frets if y > 0.2]
    parts.append(cad.slab(0.085, 0.17, 0.016, 0.015).at(y=0.76, z=depth - 0.008))
    for k in range(3):
        for side in (-1, 1):
            y = 0.71 + 0.045 * k
            parts.append(cad.cylinder(0.005, 0.016).at(side * 0.028, y, depth + 0.006))
            parts.append(cad.superquadric((0.012, 0.008, 0.006)).at(side * 0.055, y, depth))
    for s in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5):
        z = depth + 0.015
        parts.append(cad.rod((0.0075 * s, -0.12, z), (0.0065 * s, 0.7, z), 0.0008))
    return parts


def spectacles(cad: Modeller, member: int) -> Item:
    width, height = cad.between(0.022, 0.028), cad.between(0.016, 0.024)
    power = (1.0, 0.6, 0.45)[member % 3]
    angles = np.linspace(0, 2 * np.pi, cad.steps(0.03), endpoint=False)
    x = width * np.sign(np.cos(angles)) * np.abs(np.cos(angles)) ** power
    z = height * np.sign(np.sin(angles)) * np.abs(np.sin(angles)) ** power
    rim = np.column_stack([x + width + 0.009, np.zeros_like(x), z])
    thick = cad.between(0.0012, 0.0024)
    right = [cad.tube(rim, thick, closed=True)]
    outer = 2 * width + 0.009
    xs, ys = (0.0, 0.006, 0.006, 0.003, 0.0), (0.0, 0.004, 0.09, 0.115, 0.135)
    zs = (0.5, 0.5, 0.5, 0.3, -0.8)
    temple = [(outer + x, y, height * share) for x, y, share in zip(xs, ys, zs, strict=True)]
    right.append(cad.tube(cad.smooth(temple), thick))
    right.append(cad.superquadric((0.0015, 0.004, 0.006)).at(0.006, 0.006, -0.002))
    if member % 2:
        edge = closed_curve([point(corner) for corner in rim[:, [0, 2]]], 1)
        right.append(extrude(edge, 0.001).at(tilt=90).at(y=0.0005))
    side = join(right)
    end, crest = (0.0092, 0, 0.003), (0.004, -0.001, 0.007)
    path = [(-end[0], *end[1:]), (-crest[0], *crest[1:]), crest, end]
    bridge = cad.tube(cad.smooth(path), thick)
    return clutter("spectacles", side, side.mirrored(), bridge)
