"""Models of street furniture and plants on z = 0; street furniture faces -y."""

from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats, Ints
from virtual_lidar.scenes.bodies import Body, Item
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import arc, circle, line, polygon, rectangle
from virtual_lidar.scenes.solids import extrude
from virtual_lidar.scenes.surfaces import Surface, freeform, join

SHELTER = (4.2, 1.6)
"""Length and depth of a bus shelter, m."""


def arm_lamp(cad: Modeller) -> Item:
    height, reach = cad.between(6.5, 8.0), cad.between(1.2, 1.9)
    foot = cad.cylinder(0.11, 1.0)
    post = cad.cone(0.085, 0.05, height - 1.0).at(z=1.0)
    path = [(0, 0, height), (0, 0, height + 0.5), (0, -reach, height + 0.7)]
    arm = cad.pipe(path, 0.04, 0.3)
    head = cad.slab(0.24, 0.6, 0.1, 0.06).at(y=-reach - 0.2, z=height + 0.62)
    return [Body("lamp_post", "pole", foot + post), Body("lamp", "pole", arm + head)]


def globe_lamp(cad: Modeller) -> Item:
    height = cad.between(3.6, 4.4)
    post = [cad.cylinder(0.09, 0.7), cad.cylinder(0.055, height - 0.7).at(z=0.7)]
    globe = [cad.cone(0.06, 0.14, 0.12).at(z=height), cad.sphere(0.24).at(z=height + 0.33)]
    return [Body("lamp_post", "pole", join(post)), Body("lamp", "pole", join(globe))]


def sign(cad: Modeller) -> Item:
    """Make a round, triangular or square traffic sign, facing along x."""
    height = cad.between(2.2, 2.7)
    triangle = polygon((-0.4, -0.23), (0.4, -0.23), (0.0, 0.46))
    outline = cad.pick((circle(0.3, cad.steps(0.3)), triangle, rectangle(0.5, 0.7)))
    plate = extrude(outline, 0.03).at(tilt=90).at(turn=90).at(x=0.04, z=height - 0.4)
    post = cad.cylinder(0.03, height)
    return [Body("sign_post", "pole", post), Body("sign", "sign", plate)]


def bollard(cad: Modeller) -> Item:
    radius, height = 0.065, 0.85
    top = arc((0.0, height), radius, 0, 90, cad.steps(radius) // 4)
    post = cad.turned(line((0, 0), (radius, 0), (radius, height)), top)
    return [Body("bollard", "pole", post)]


def bench(cad: Modeller) -> Item:
    return [Body("bench", "bench", _bench(cad, 1.8))]


def _bench(cad: Modeller, length: float) -> Surface:
    seat = [cad.box(length, 0.11, 0.04).at(y=y, z=0.42) for y in (-0.14, 0.0, 0.14)]
    back = [cad.box(length, 0.03, 0.11).at(y=0.25, z=z) for z in (0.55, 0.7)]
    legs = cad.box(0.06, 0.38, 0.42) + cad.box(0.06, 0.05, 0.82).at(y=0.29)
    stands = legs.at_sides(length / 2 - 0.25)
    return join([*seat, *back, *stands])


def litter_bin(cad: Modeller) -> Item:
    drum = cad.cylinder(0.22, 0.8)
    return [Body("bin", "bin", join([drum, cad.torus(0.22, 0.025).at(z=0.8)]))]


def cabinet(cad: Modeller) -> Item:
    width, height = cad.between(0.6, 1.3), cad.between(0.9, 1.3)
    plinth = cad.box(width, 0.36, 0.1)
    return [Body("cabinet", "box", join([plinth, cad.slab(width, 0.34, height, 0.02).at(z=0.1)]))]


def shelter(cad: Modeller) -> Item:
    length, depth = SHELTER
    y, x = depth / 2 - 0.1, length / 2 - 0.15
    panes = [cad.box(length - 0.4, 0.03, 1.9).at(y=y, z=0.3)]
    panes.append(cad.box(0.03, depth - 0.5, 1.9).at(x, 0.1, 0.3))
    posts = cad.box(0.08, 0.08, 2.4).at_corners(x, y)
    roof = cad.slab(length, depth, 0.12, 0.1).at(z=2.4)
    seat = _bench(cad, 2.2).at(y=y - 0.4)
    hut = Body("shelter", "shelter", join([*panes, *posts, roof]))
    return [hut, Body("bench", "bench", seat)]


def fence(cad: Modeller, length: float) -> Item:
    height = cad.between(0.9, 1.3)
    count = max(2, round(length / 0.16))
    picket = cad.box(0.08, 0.02, height)
    places = np.linspace(0.04 - length / 2, length / 2 - 0.04, count)
    rails = [cad.box(length, 0.04, 0.06).at(y=0.03, z=z) for z in (0.2, height - 0.25)]
    return [Body("fence", "fence", join([*rails, *(picket.at(x=float(x)) for x in places)]))]


def garden_wall(cad: Modeller, length: float, height: float) -> Item:
    wall, coping = cad.box(length, 0.24, height), cad.box(length, 0.3, 0.07).at(z=height)
    return [Body("garden_wall", "fence", join([wall, coping]))]


_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def tree(cad: Modeller) -> Item:
    """Make a street tree with a trunk, boughs and a partly transparent crown of 2.2 m radius."""
    trunk, height = cad.between(0.11, 0.2), cad.between(2.5, 3.4)
    top = height + cad.between(3.0, 4.6)
    boughs, places = [], [np.array([0.0, 0.0, top - 0.9])]
    for turn in np.arange(0, 2 * np.pi, 2 * np.pi / 5) + cad.between(0, 2):
        out, z = cad.between(0.6, 0.95), cad.between(height + 0.9, top - 1.2)
        places.append(np.array([out * np.cos(turn), out * np.sin(turn), z]))
        boughs.append(cad.rod((0, 0, height - 0.1), places[-1].tolist(), trunk * 0.35))
    radii = cad.rng.uniform((0.75, 0.75, 0.6), (1.05, 1.05, 1.1), (len(places), 3))
    stem = cad.cylinder(trunk, height)
    lead = cad.cone(trunk * 0.9, 0.03, top - height - 0.6).at(z=height)
    crown = foliage(cad, np.array(places), radii, int(cad.rng.integers(420, 580)), 0.3)
    return [
        Body("trunk", "trunk", stem),
        Body("boughs", "trunk", join([lead, *boughs])),
        Body("crown", "vegetation", crown),
    ]


def bush(cad: Modeller) -> Item:
    radii = cad.rng.uniform((0.5, 0.5, 0.4), (0.9, 0.9, 0.8))
    middle = np.array([[0.0, 0.0, 0.75 * radii[2]]])
    leaves = foliage(cad, middle, radii[None], 150, 0.14)
    return [Body("bush", "vegetation", _above(leaves))]


def hedge(cad: Modeller, length: float) -> Item:
    height, depth = cad.between(1.0, 1.8), cad.between(0.5, 0.8)
    core = cad.box(length - 0.1, depth * 0.7, height - 0.1).deformed(np.array)
    count = int(32 * length * (2 * height + depth))
    places = cad.rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0), (count, 3))
    side = cad.rng.random(count) * (2 * height + depth)
    upright = side < 2 * height
    places[upright, 1] = np.where(side[upright] < height, -0.5, 0.5)
    places[~upright, 2] = 1.0
    places = places * (length, depth, height) + cad.rng.normal(0, 0.04, (count, 3))
    return [Body("hedge", "vegetation", _above(join([core, _leaves(cad, places, 0.13)])))]


def foliage(cad: Modeller, middles: Floats, radii: Floats, count: int, size: float) -> Surface:
    """Make leaves that fill ellipsoids and are denser near their surfaces.

    Parameters
    ----------
    cad
        Source of random numbers.
    middles, radii
        Centres and half axes of k ellipsoids, (k, 3), m.
    count
        Number of leaves of all ellipsoids, which are distributed in proportion to volume.
    size
        Size of a leaf, m.
    """
    volumes = radii.prod(axis=1)
    ellipsoid = cad.rng.choice(len(radii), count, p=volumes / volumes.sum())
    ways = cad.rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    share = cad.rng.random((count, 1)) ** 0.25
    return _leaves(cad, middles[ellipsoid] + radii[ellipsoid] * ways * share, size)


def _leaves(cad: Modeller, places: Floats, size: float) -> Surface:
    corners = cad.rng.uniform(-1, 1, (len(places), 4, 3)) * size / np.sqrt(2)
    corners[:, 3] = corners[:, :3].mean(axis=1) + 0.2 * corners[:, 3]
    a, b, c, d = corners.swapaxes(0, 1)
    inverted = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0
    corners[inverted] = corners[inverted][:, [1, 0, 2, 3]]
    triangles: Ints = (np.arange(len(places))[:, None, None] * 4 + _FACES).reshape(-1, 3)
    return freeform((corners + places[:, None]).reshape(-1, 3), triangles)


def _above(leaves: Surface) -> Surface:
    return leaves.deformed(lambda points: np.maximum(points, (-np.inf, -np.inf, 0.0)))
