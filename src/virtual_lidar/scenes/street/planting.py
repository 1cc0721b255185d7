from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats, Ints
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.pieces import Item, Piece
from virtual_lidar.scenes.surfaces import Surface, freeform, join

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
        Piece("trunk", "trunk", stem),
        Piece("boughs", "trunk", join([lead, *boughs])),
        Piece("crown", "vegetation", crown),
    ]


def bush(cad: Modeller) -> Item:
    radii = cad.rng.uniform((0.5, 0.5, 0.4), (0.9, 0.9, 0.8))
    middle = np.array([[0.0, 0.0, 0.75 * radii[2]]])
    leaves = foliage(cad, middle, radii[None], 150, 0.14)
    return [Piece("bush", "vegetation", _above(leaves))]


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
    return [Piece("hedge", "vegetation", _above(join([core, _leaves(cad, places, 0.13)])))]


def foliage(cad: Modeller, middles: Floats, radii: Floats, count: int, size: float) -> Surface:
    """Make `count` leaves in k ellipsoids with centres `middles` and half axes `radii` (k, 3), m.

    Larger ellipsoids get more leaves, by volume; leaves are denser near the surfaces.
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
