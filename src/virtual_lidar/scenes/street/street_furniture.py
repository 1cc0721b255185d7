from __future__ import annotations

import numpy as np

from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import arc, circle, line, polygon, rectangle
from virtual_lidar.scenes.pieces import Item, Piece
from virtual_lidar.scenes.solids import extrude
from virtual_lidar.scenes.surfaces import Surface, join

SHELTER = (4.2, 1.6)
"""Length and depth of a bus shelter, m."""


def arm_lamp(cad: Modeller) -> Item:
    height, reach = cad.between(6.5, 8.0), cad.between(1.2, 1.9)
    foot = cad.cylinder(0.11, 1.0)
    post = cad.cone(0.085, 0.05, height - 1.0).at(z=1.0)
    path = [(0, 0, height), (0, 0, height + 0.5), (0, -reach, height + 0.7)]
    arm = cad.pipe(path, 0.04, 0.3)
    head = cad.slab(0.24, 0.6, 0.1, 0.06).at(y=-reach - 0.2, z=height + 0.62)
    return [Piece("lamp_post", "pole", foot + post), Piece("lamp", "pole", arm + head)]


def globe_lamp(cad: Modeller) -> Item:
    height = cad.between(3.6, 4.4)
    post = [cad.cylinder(0.09, 0.7), cad.cylinder(0.055, height - 0.7).at(z=0.7)]
    globe = [cad.cone(0.06, 0.14, 0.12).at(z=height), cad.sphere(0.24).at(z=height + 0.33)]
    return [Piece("lamp_post", "pole", join(post)), Piece("lamp", "pole", join(globe))]


def sign(cad: Modeller) -> Item:
    """Make a round, triangular or square traffic sign, facing along x."""
    height = cad.between(2.2, 2.7)
    triangle = polygon((-0.4, -0.23), (0.4, -0.23), (0.0, 0.46))
    outline = cad.pick((circle(0.3, cad.steps(0.3)), triangle, rectangle(0.5, 0.7)))
    plate = extrude(outline, 0.03).at(tilt=90).at(turn=90).at(x=0.04, z=height - 0.4)
    post = cad.cylinder(0.03, height)
    return [Piece("sign_post", "pole", post), Piece("sign", "sign", plate)]


def bollard(cad: Modeller) -> Item:
    radius, height = 0.065, 0.85
    top = arc((0.0, height), radius, 0, 90, cad.steps(radius) // 4)
    post = cad.turned(line((0, 0), (radius, 0), (radius, height)), top)
    return [Piece("bollard", "pole", post)]


def bench(cad: Modeller) -> Item:
    return [Piece("bench", "bench", _bench(cad, 1.8))]


def _bench(cad: Modeller, length: float) -> Surface:
    seat = [cad.box(length, 0.11, 0.04).at(y=y, z=0.42) for y in (-0.14, 0.0, 0.14)]
    back = [cad.box(length, 0.03, 0.11).at(y=0.25, z=z) for z in (0.55, 0.7)]
    legs = cad.box(0.06, 0.38, 0.42) + cad.box(0.06, 0.05, 0.82).at(y=0.29)
    stands = legs.at_sides(length / 2 - 0.25)
    return join([*seat, *back, *stands])


def litter_bin(cad: Modeller) -> Item:
    drum = cad.cylinder(0.22, 0.8)
    return [Piece("bin", "bin", join([drum, cad.torus(0.22, 0.025).at(z=0.8)]))]


def cabinet(cad: Modeller) -> Item:
    width, height = cad.between(0.6, 1.3), cad.between(0.9, 1.3)
    plinth = cad.box(width, 0.36, 0.1)
    return [Piece("cabinet", "box", join([plinth, cad.slab(width, 0.34, height, 0.02).at(z=0.1)]))]


def shelter(cad: Modeller) -> Item:
    length, depth = SHELTER
    y, x = depth / 2 - 0.1, length / 2 - 0.15
    panes = [cad.box(length - 0.4, 0.03, 1.9).at(y=y, z=0.3)]
    panes.append(cad.box(0.03, depth - 0.5, 1.9).at(x, 0.1, 0.3))
    posts = cad.box(0.08, 0.08, 2.4).at_corners(x, y)
    roof = cad.slab(length, depth, 0.12, 0.1).at(z=2.4)
    seat = _bench(cad, 2.2).at(y=y - 0.4)
    hut = Piece("shelter", "shelter", join([*panes, *posts, roof]))
    return [hut, Piece("bench", "bench", seat)]


def fence(cad: Modeller, length: float) -> Item:
    height = cad.between(0.9, 1.3)
    count = max(2, round(length / 0.16))
    picket = cad.box(0.08, 0.02, height)
    places = np.linspace(0.04 - length / 2, length / 2 - 0.04, count)
    rails = [cad.box(length, 0.04, 0.06).at(y=0.03, z=z) for z in (0.2, height - 0.25)]
    return [Piece("fence", "fence", join([*rails, *(picket.at(x=float(x)) for x in places)]))]


def garden_wall(cad: Modeller, length: float, height: float) -> Item:
    wall, coping = cad.box(length, 0.24, height), cad.box(length, 0.3, 0.07).at(z=height)
    return [Piece("garden_wall", "fence", join([wall, coping]))]
