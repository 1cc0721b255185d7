from __future__ import annotations

import numpy as np

from virtual_lidar.scenes.bodies import Body, Item
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import arc, line, polar, ring
from virtual_lidar.scenes.solids import extrude, sheet
from virtual_lidar.scenes.surfaces import Surface, join


def office_chair(cad: Modeller) -> Item:
    height = cad.between(0.43, 0.5)
    arms = [_castor_arm(cad).at(turn=72.0 * k + 18) for k in range(5)]
    column = [cad.cylinder(0.03, 0.2).at(z=0.08), cad.cylinder(0.018, height - 0.2).at(z=0.2)]
    hub = cad.cone(0.05, 0.035, 0.06).at(z=0.07)
    plate = cad.box(0.2, 0.2, 0.03).at(z=height - 0.03)
    seat = cad.cushion(0.5, 0.48, 0.1, 0.4).at(z=height)
    path = [(0, 0.1, height - 0.01), (0, 0.3, height - 0.01), (0, 0.29, height + 0.4)]
    spine = cad.pipe(path, 0.02, 0.05)
    back = cad.cushion(0.46, 0.1, cad.between(0.5, 0.7), 0.4).at(y=0.24, z=height + 0.16, tilt=-6)
    parts = [*arms, *column, hub, plate, seat, spine, back]
    if cad.chance(0.7):
        armrest = _armrest(cad, height)
        parts += [armrest, armrest.mirrored()]
    return [Body("office_chair", "chair", join(parts))]


def _castor_arm(cad: Modeller) -> Surface:
    arm = cad.cone(0.03, 0.018, 0.3).at(roll=90).at(z=0.1, roll=5)
    wheel = cad.cylinder(0.028, 0.018).at(tilt=90)
    wheels = [wheel.at(0.29, y, 0.028) for y in (0.03, -0.012)]
    return join([arm, cad.cylinder(0.008, 0.06).at(x=0.29, z=0.03), *wheels])


def _armrest(cad: Modeller, height: float) -> Surface:
    frame = [(0.2, 0.02, height - 0.02), (0.29, 0.02, height - 0.02), (0.29, 0.02, height + 0.22)]
    pad = cad.slab(0.08, 0.26, 0.03, 0.035).at(x=0.29, y=0.02, z=height + 0.21)
    return cad.pipe(frame, 0.014, 0.04) + pad


def chair(cad: Modeller) -> Item:
    width, depth, height = (cad.between(0.4, 0.46), cad.between(0.4, 0.46), cad.between(0.43, 0.47))
    seat = cad.slab(width, depth, 0.035, 0.06).at(z=height - 0.035)
    x, y = width / 2 - 0.045, depth / 2 - 0.045
    corners = [(a * x, b * y) for b in (-1, 1) for a in (-1, 1)]
    legs = [cad.rod((a * 1.1, b * 1.1, 0), (a, b, height - 0.03), 0.014) for a, b in corners]
    low, high = height - 0.01, height + 0.42
    posts = [cad.rod((a, y, low), (a, y + 0.09, high), 0.012) for a in (-x, x)]
    slat = _curved_back(cad, width, 0.11)
    back = [slat.at(y=y + 0.04 + 0.045 * k, z=height + 0.16 + 0.15 * k) for k in range(2)]
    rungs = [cad.rod((a, -y, 0.2), (a, y, 0.2), 0.009) for a in (-x, x)]
    return [Body("chair", "chair", join([seat, *legs, *posts, *back, *rungs]))]


def _curved_back(cad: Modeller, width: float, height: float) -> Surface:
    radius, steps = width * 0.9, max(4, cad.steps(width) // 6)
    outer = arc((0, -radius), radius + 0.012, 58, 122, steps)
    inner = arc((0, -radius), radius, 122, 58, steps)
    return extrude(ring(outer, inner), height)


def shell_chair(cad: Modeller) -> Item:
    side = np.linspace(-1, 1, max(9, cad.steps(0.2) // 3))
    half, top = cad.between(0.21, 0.24), cad.between(0.76, 0.88)
    profile = cad.smooth(
        [(-0.24, 0.43), (-0.2, 0.455), (0.05, 0.43), (0.17, 0.47), (0.2, 0.62), (0.25, top)]
    )
    across = half * (1 - 0.15 * np.linspace(0, 1, len(profile)) ** 2)
    x = side[None, :] * across[:, None]
    lift = 0.05 * side[None, :] ** 2
    forward = lift * np.linspace(0, 1.6, len(profile))[:, None]
    y = profile[:, :1] - forward
    z = profile[:, 1:] + lift * np.linspace(1.0, 0.2, len(profile))[:, None]
    shell = sheet(np.stack([x, y + 0 * x, z], axis=-1).swapaxes(0, 1), 0.012)
    legs = cad.legs((0.23, 0.22), (0.1, 0.1), 0.43, 0.013)
    return [Body("shell_chair", "chair", join([shell, *legs]))]


def stool(cad: Modeller) -> Item:
    height = cad.between(0.45, 0.72)
    base = cad.turned(line((0, 0), (0.2, 0), (0.2, 0.015), (0.03, 0.04), (0, 0.04)))
    column = cad.cylinder(0.025, height - 0.08).at(z=0.03)
    seat = cad.superquadric((0.18, 0.18, 0.035), (0.5, 1.0)).at(z=height - 0.035)
    ring = cad.torus(0.13, 0.01).at(z=0.22)
    ends = polar(0.13, np.radians((0, 120, 240)))
    spokes = [cad.rod((0, 0, 0.22), (x, y, 0.22), 0.006) for x, y in ends]
    return [Body("stool", "chair", join([base, column, seat, ring, *spokes]))]


def sofa(cad: Modeller, seats: int = 2) -> Item:
    seat, depth, arm = cad.between(0.58, 0.68), 0.85, 0.17
    width = seats * seat + 2 * arm
    parts = [cad.slab(width - 0.02, depth, 0.2, 0.04).at(z=0.1)]
    parts += cad.cone(0.02, 0.03, 0.1).at_corners(width / 2 - 0.1, depth / 2 - 0.08)
    parts.append(cad.cushion(width - 2 * arm, 0.22, 0.55).at(y=depth / 2 - 0.12, z=0.25))
    for k in range(seats):
        x = (k - (seats - 1) / 2) * seat
        parts.append(cad.cushion(seat - 0.01, 0.62, 0.17, 0.3).at(x, -0.1, 0.29))
        parts.append(cad.cushion(seat - 0.02, 0.17, 0.42, 0.5).at(x, 0.15, 0.44, tilt=-12))
    roll = cad.cylinder(arm / 2, depth).at(y=depth / 2, tilt=90)
    for side in (-1, 1):
        x = side * (width / 2 - arm / 2)
        parts += [cad.box(arm * 0.86, depth - 0.02, 0.32).at(x, 0, 0.25), roll.at(x=x, z=0.57)]
    return [Body("sofa" if seats > 1 else "armchair", "sofa", join(parts))]


def auditorium_seat(cad: Modeller) -> Item:
    high, lean = cad.between(0.5, 0.6), -cad.between(7, 13)
    sides = cad.slab(0.05, 0.4, 0.6, 0.02).at_sides(0.27)
    seat = cad.cushion(0.47, 0.4, 0.1, 0.35).at(y=-0.03, z=0.38)
    back = cad.cushion(0.47, 0.09, high, 0.3).at(y=0.2, z=0.4, tilt=lean)
    pads = cad.cushion(0.07, 0.3, 0.04, 0.5).at_sides(0.27, -0.03, 0.59)
    return [Body("seat", "chair", join([*sides, seat, back, *pads]))]
