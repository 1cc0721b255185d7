from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.bodies import Item
from virtual_lidar.scenes.furniture.small import clutter
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import line
from virtual_lidar.scenes.solids import sheet
from virtual_lidar.scenes.surfaces import Surface


def pot(cad: Modeller, radius: float, height: float) -> Surface:
    low, wall = radius * 0.72, radius * 0.08
    edge = height * 0.85
    outside = ((0, 0), (low, 0), (radius, edge), (radius + wall, edge), (radius + wall, height))
    inside = ((radius - wall, height), (radius - wall, height * 0.9), (0, height * 0.9))
    profile = line(*outside, *inside)
    return cad.turned(profile)


def leaf(cad: Modeller, length: float, width: float, droop: float) -> Surface:
    steps = max(5, round(9 * cad.detail))
    t = np.linspace(0, 1, steps)
    half = width / 2 * np.sin(np.pi * t**0.8) ** 0.9 + width * 0.02
    x, z = length * (t - droop * 0.25 * t**3), length * (0.7 * t - (0.55 + droop) * t**2)
    side = np.linspace(-1, 1, 5)
    points = np.empty((steps, 5, 3))
    points[..., 0] = x[:, None]
    points[..., 1] = half[:, None] * side
    points[..., 2] = z[:, None] + 0.4 * half[:, None] * np.abs(side)
    return sheet(points, 0.002)


def plant(cad: Modeller) -> Item:
    radius, height = cad.between(0.13, 0.18), cad.between(0.25, 0.35)
    leaves = []
    count = int(cad.rng.integers(14, 24))
    for k in range(count):
        length = cad.between(0.35, 0.7)
        blade = leaf(cad, length, length * cad.between(0.16, 0.26), cad.between(0.0, 0.35))
        pitch = -cad.between(5, 55)
        leaves.append(blade.at(z=height * 0.9, turn=137.5 * k, roll=pitch))
    return clutter("plant", pot(cad, radius, height), *leaves)


def small_tree(cad: Modeller) -> Item:
    stem = _stem(cad)
    leaves = []
    for k, at in enumerate(np.linspace(0.3, 1.0, 26)):
        x, y, z = stem[int(at * (len(stem) - 1))]
        blade = leaf(cad, cad.between(0.22, 0.36), 0.12, cad.between(0.2, 0.7))
        leaves.append(blade.at(x, y, z, turn=137.5 * k, roll=-cad.between(0, 50)))
    thick = np.linspace(0.02, 0.007, len(stem))
    return clutter("small_tree", pot(cad, 0.18, 0.32), cad.tube(stem, thick), *leaves)


def _stem(cad: Modeller) -> Floats:
    bends = [(0.0, 0.0, 0.28)]
    for z in (0.6, 0.95, 1.3, cad.between(1.5, 1.75)):
        x, y, _ = bends[-1]
        bends.append((x + cad.between(-0.07, 0.07), y + cad.between(-0.07, 0.07), z))
    return cad.smooth(bends)


def cactus(cad: Modeller) -> Item:
    trunk = cad.superquadric((0.07, 0.07, 0.3), (0.6, 1.0)).at(z=0.45)
    arm = cad.superquadric((0.04, 0.04, 0.14), (0.6, 1.0))
    arms = [arm.at(0.12, 0, 0.6), arm.at(-0.12, 0, 0.5)]
    joints = [cad.rod((0, 0, z), (x, 0, z), 0.03) for x, z in ((0.12, 0.5), (-0.12, 0.4))]
    return clutter("cactus", pot(cad, 0.11, 0.18), trunk, *arms, *joints)
