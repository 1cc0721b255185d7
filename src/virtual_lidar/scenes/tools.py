"""Models of hammers, screws, gears and pipe fittings.

Each public function makes one object of a class. The argument `member` is the number of the object
in the class, from 0, which selects the variant. Other choices are random.
"""

from __future__ import annotations

import numpy as np

from virtual_lidar.scenes.bodies import Item
from virtual_lidar.scenes.furniture.small import clutter
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import (
    Outline,
    Segment,
    arc,
    circle,
    line,
    loop,
    polar,
    polygon,
    rectangle,
    rounded,
)
from virtual_lidar.scenes.solids import extrude, loft
from virtual_lidar.scenes.surfaces import Surface, grid, join


def hammer(cad: Modeller, member: int) -> Item:
    """Make a claw hammer, ball-peen hammer, mallet or sledgehammer."""
    head = (_claw, _ball_peen, _mallet, _sledge)[member % 4](cad)
    return clutter("hammer", _handle(cad, cad.between(0.26, 0.34)), head)


def _handle(cad: Modeller, length: float) -> Surface:
    stations = np.array([0.0, 0.05, 0.3, 0.55, 0.8, 0.95, 1.0])
    widths = np.array([0.010, 0.014, 0.011, 0.013, 0.017, 0.018, 0.012]) * cad.between(0.9, 1.15)
    smooth = cad.smooth(np.column_stack([stations, widths]).tolist())
    angles = np.linspace(0, 2 * np.pi, cad.steps(0.03), endpoint=False)
    sections = np.empty((len(smooth), len(angles), 3))
    sections[..., 0] = smooth[:, 1:] * 1.35 * np.cos(angles)
    sections[..., 1] = smooth[:, 1:] * np.sin(angles)
    sections[..., 2] = (0.015 - length * smooth[:, :1]) * np.ones(len(angles))
    return loft(sections[::-1])


def _claw(cad: Modeller) -> Surface:
    radii, heights = (0.012, 0.015, 0.015, 0.011, 0.011), (0, 0.004, 0.02, 0.028, 0.05)
    face = cad.turned(line((0, 0), *zip(radii, heights, strict=True), (0, 0.05)))
    block = cad.slab(0.04, 0.028, 0.03, 0.006).at(z=-0.015)
    drop = cad.between(0.02, 0.035)
    path = cad.smooth([(-0.015, 0, 0), (-0.04, 0, 0.002), (-0.07, 0, -0.01), (-0.09, 0, -drop)])
    t = np.linspace(0, 1, len(path))[:, None]
    claws = []
    for side in (-1, 1):
        bent = path + np.column_stack([0 * t, side * (0.005 + 0.008 * t), 0 * t])
        claws.append(cad.tube(bent, 0.009 - 0.006 * t[:, 0]))
    return join([face.at(x=0.062, roll=-90), block, *claws])


def _ball_peen(cad: Modeller) -> Surface:
    radii = (0.0, 0.014, 0.016, 0.016, 0.010, 0.013, 0.013, 0.008)
    heights = (0.0, 0.0, 0.003, 0.018, 0.026, 0.034, 0.056, 0.064)
    face = line(*zip(radii, heights, strict=True))
    ball = arc((0, 0.076), 0.0144, -56, 90, max(6, cad.steps(0.02) // 2))
    return cad.turned(face, ball).at(x=0.045, roll=-90)


def _mallet(cad: Modeller) -> Surface:
    radius, length = cad.between(0.03, 0.042), cad.between(0.1, 0.13)
    corners = [(-0.1, 0.0), (radius, 0.0), (radius, length), (-0.1, length)]
    return cad.turned(_right_half(rounded(corners, 0.006, 6))).at(x=length / 2, roll=-90)


def _right_half(outline: Outline) -> Outline:
    points = loop(outline)
    low, high = float(points[:, 1].min()), float(points[:, 1].max())
    segments = [segment for segment in outline if segment.points[:, 0].min() > 0]
    first, last = segments[0].points[0], segments[-1].points[-1]
    lower = line((0.0, low), (float(first[0]), low))
    return (*lower, *segments, *line((float(last[0]), high), (0.0, high)))


def _sledge(cad: Modeller) -> Surface:
    size = cad.between(0.04, 0.055)
    corners = polar(size * 0.54, np.radians(np.arange(22.5, 360, 45)))
    octagon = polygon(*corners)
    body = extrude(octagon, size * 2.2).at(x=size * 1.1, roll=-90)
    caps = cad.superquadric((size * 0.46, size * 0.46, size * 0.12)).at_sides(size * 1.1, roll=90)
    return join([body, *caps])


def screw(cad: Modeller, member: int) -> Item:
    """Make a screw with a hexagonal, slotted, countersunk or socket head."""
    radius, length = cad.between(0.07, 0.11), cad.between(0.6, 0.9)
    pitch = radius * cad.between(0.32, 0.5)
    point = radius * 2.2 if member % 3 == 2 else radius * 0.3
    end = (0.0, -point) if member % 3 == 2 else (radius * 0.75, -point)
    profile = line((0, -point), end, (radius, 0), (radius, length), (0, length))
    shank = cad.turned(profile[1:] if member % 3 == 2 else profile)
    share = 1.0 if member % 2 else cad.between(0.55, 0.8)
    head = (_hex_head, _slotted_head, _flat_head, _socket_head)[member % 4](cad, radius * 2)
    return clutter("screw", shank, _thread(cad, radius, pitch, length * share), head.at(z=length))


def _thread(cad: Modeller, radius: float, pitch: float, length: float) -> Surface:
    """Make a helical ridge on a cylinder from z = 0 to `length` that tapers off at both ends."""
    turns = length / pitch
    count = max(16, int(turns * cad.steps(0.03)))
    along = np.linspace(0, 1, count)
    height = pitch * 0.55 * np.clip(np.minimum(along, 1 - along) * turns / 0.7, 0, 1)
    angle = 2 * np.pi * turns * along
    ridge = np.array([(-0.45, -0.12), (-0.08, 1.0), (0.08, 1.0), (0.45, -0.12)])
    r = radius + np.where(ridge[:, 1] > 0, height[:, None], -0.12 * pitch)
    spread = np.clip(height[:, None] / (0.55 * pitch), 0.02, 1)
    z = length * along[:, None] + ridge[:, 0] * pitch * spread
    points = np.stack([r * np.cos(angle)[:, None], r * np.sin(angle)[:, None], z], axis=-1)
    return grid(points)


def _hex_head(cad: Modeller, size: float) -> Surface:
    corners = polar(size, np.radians(np.arange(0, 360, 60)))
    washer = cad.cylinder(size * 1.15, size * 0.12)
    return extrude(polygon(*corners), size * 0.7).at(z=size * 0.1) + washer


def _slotted_head(cad: Modeller, size: float) -> Surface:
    slot = [rectangle(size * 0.24, size * 1.7)]
    rim = arc((size * 0.8, size * 0.2), size * 0.2, -90, 0, max(4, cad.steps(size) // 8))
    side = line((size, size * 0.2), (size, size * 0.3), (0, size * 0.3))
    plate = extrude(circle(size, cad.steps(size)), size * 0.3, slot)
    return cad.turned(line((0, 0), (size * 0.8, 0)), rim, side) + plate.at(z=size * 0.3)


def _flat_head(cad: Modeller, size: float) -> Surface:
    side = line((0, -size * 0.6), (size * 0.5, -size * 0.6), (size, 0), (size, size * 0.05))
    a, b = size * 0.12, size * 0.5
    cross = [(-a, -b), (a, -b), (a, -a)]
    for _ in range(3):
        cross += [(-y, x) for x, y in cross[-3:]]
    plate = extrude(circle(size, cad.steps(size)), size * 0.2, [polygon(*cross)])
    return cad.turned(side) + plate.at(z=size * 0.05)


def _socket_head(cad: Modeller, size: float) -> Surface:
    corners = polar(size * 0.5, np.radians(np.arange(0, 360, 60)))
    ring = extrude(circle(size * 0.9, cad.steps(size)), size * 0.8, [polygon(*corners)])
    return ring.at(z=size * 0.2) + cad.cylinder(size * 0.9, size * 0.2)


def gear(cad: Modeller, member: int) -> Item:
    """Make a spur gear with a keyway, and a hub, lightening holes, a second gear or a shaft."""
    teeth = int(cad.rng.integers(12, 34))
    width = cad.between(0.08, 0.22)
    bore, style = cad.between(0.08, 0.13), member % 4
    holes: list[Outline] = [_keyed_bore(cad, bore)] if style != 3 else []
    if style in (0, 1):
        count = int(cad.rng.integers(4, 7))
        spots = polar(0.27, 2 * np.pi * np.arange(count) / count)
        holes += [circle(cad.between(0.05, 0.075), cad.steps(0.06), spot) for spot in spots]
    parts = [extrude(_toothed(cad, teeth, 0.5), width, holes)]
    if style == 1:
        hub = extrude(circle(bore * 1.6, cad.steps(bore)), width * 1.8, holes[:1])
        parts.append(hub.at(z=-width * 0.4))
    if style == 2:
        parts.append(extrude(_toothed(cad, max(9, teeth // 2), 0.28), width, holes).at(z=width))
    if style == 3:
        parts.append(cad.cylinder(bore, width * 5).at(z=-width * 2))
    return clutter("gear", *parts)


def _toothed(cad: Modeller, teeth: int, radius: float) -> Outline:
    step = 360.0 / teeth
    root = radius * (1 - 4.2 / (teeth + 6))
    steps = max(2, cad.steps(radius) // (4 * teeth) + 1)
    outline: list[Segment] = []
    for k in range(teeth):
        start = k * step
        low = arc((0, 0), root, start, start + 0.36 * step, steps)
        high = arc((0, 0), radius, start + 0.54 * step, start + 0.82 * step, steps)
        following = np.radians(start + step)
        next_low = root * np.array([np.cos(following), np.sin(following)])
        up = Segment("line", np.stack([low[0].points[-1], high[0].points[0]]))
        down = Segment("line", np.stack([high[0].points[-1], next_low]))
        outline += [*low, up, *high, down]
    return tuple(outline)


def _keyed_bore(cad: Modeller, radius: float) -> Outline:
    half = radius * 0.25
    angle = float(np.degrees(np.arcsin(half / radius)))
    x = float(np.sqrt(radius**2 - half**2))
    ring = arc((0, 0), radius, angle, 360 - angle, cad.steps(radius))
    return (*ring, *line((x, -half), (radius * 1.25, -half), (radius * 1.25, half), (x, half)))


def pipe_fitting(cad: Modeller, member: int) -> Item:
    """Make an elbow, tee, cross, reducer, flanged pipe or valve."""
    makers = (_elbow, _tee, _cross, _reducer, _flanged, _valve)
    return clutter("pipe_fitting", makers[member % len(makers)](cad, cad.between(0.1, 0.15)))


def _collar(cad: Modeller, radius: float) -> Surface:
    outer, depth = radius * cad.pick((1.25, 1.35)), radius * 1.1
    inner, floor = radius * 0.9, -depth * 0.85
    outside = line((0, -depth), (outer, -depth), (outer, -0.12 * radius), (outer * 0.94, 0))
    return cad.turned(outside, line((outer * 0.94, 0), (inner, 0), (inner, floor), (0, floor)))


def _branch(cad: Modeller, radius: float, length: float) -> Surface:
    return cad.cylinder(radius, length - radius * 0.5) + _collar(cad, radius).at(z=length)


def _elbow(cad: Modeller, radius: float) -> Surface:
    bend = radius * cad.between(1.5, 2.5)
    arm = bend + radius * 0.8
    body = cad.pipe([(-arm, 0, 0), (0, 0, 0), (0, 0, arm)], radius, bend)
    upper = _collar(cad, radius).at(z=arm + radius * 0.8)
    return join([body, upper, _collar(cad, radius).at(x=-arm - radius * 0.8, roll=-90)])


def _tee(cad: Modeller, radius: float) -> Surface:
    length = radius * cad.between(2.6, 3.6)
    side = radius * cad.between(0.7, 1.0)
    arms = [_branch(cad, radius, length).at(roll=angle) for angle in (90, -90)]
    return join([*arms, _branch(cad, side, length)])


def _cross(cad: Modeller, radius: float) -> Surface:
    length = radius * cad.between(2.6, 3.4)
    arms = [_branch(cad, radius, length).at(roll=angle) for angle in (0, 90, 180, 270)]
    return join([*arms, cad.sphere(radius * 1.15)])


def _reducer(cad: Modeller, radius: float) -> Surface:
    small, length = radius * cad.between(0.5, 0.7), radius * cad.between(1.5, 2.5)
    upper = _branch(cad, small, radius * 2).at(z=length)
    lower = _branch(cad, radius, radius * 2).at(tilt=180)
    return join([cad.cone(radius, small, length), upper, lower])


def _flange(cad: Modeller, radius: float, bolts: int) -> Surface:
    spots = polar(1.65 * radius, 2 * np.pi * np.arange(bolts) / bolts)
    holes = [circle(radius * 0.8, cad.steps(radius))]
    holes += [circle(radius * 0.2, cad.steps(radius * 0.2), spot) for spot in spots]
    return extrude(circle(radius * 2.1, cad.steps(radius * 2)), radius * 0.4, holes)


def _flanged(cad: Modeller, radius: float) -> Surface:
    length, bolts = radius * cad.between(3, 5), int(cad.rng.integers(4, 9))
    inner = radius * 0.8
    tube = line((radius, 0), (radius, length), (inner, length), (inner, 0), (radius, 0))
    flange = _flange(cad, radius, bolts)
    return join([cad.turned(tube), flange, flange.at(z=length - radius * 0.4)])


def _valve(cad: Modeller, radius: float) -> Surface:
    length = radius * 2.8
    arms = [_branch(cad, radius, length).at(roll=90), _branch(cad, radius, length).at(roll=-90)]
    stem = [cad.cylinder(radius * 0.6, radius * 1.6), cad.cylinder(radius * 0.25, radius * 3)]
    wheel = cad.torus(radius * 1.3, radius * 0.16).at(z=radius * 2.9)
    ends = polar(radius * 1.3, np.radians(np.arange(0, 360, 72)))
    high = radius * 2.9
    spokes = [cad.rod((0, 0, high), (x, y, high), radius * 0.1) for x, y in ends]
    return join([*arms, cad.sphere(radius * 1.3), *stem, wheel, *spokes])
