"""Potted plants."""

from __future__ import annotations

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.scenes import outlines
from puckbench.scenes.builder import Item
from puckbench.scenes.furniture.small import clutter
from puckbench.scenes.solids import sheet
from puckbench.scenes.surfaces import Surface
from puckbench.scenes.workshop import Workshop


def pot(shop: Workshop, radius: float, height: float) -> Surface:
    """Flower pot filled with earth: a cone frustum with a rim."""
    low, wall = radius * 0.72, radius * 0.08
    edge = height * 0.85
    outside = ((0, 0), (low, 0), (radius, edge), (radius + wall, edge), (radius + wall, height))
    inside = ((radius - wall, height), (radius - wall, height * 0.9), (0, height * 0.9))
    profile = outlines.line(*outside, *inside)
    return shop.turned(profile)


def leaf(shop: Workshop, length: float, width: float, droop: float) -> Surface:
    """Pointed leaf along +x from the origin, rising first and then drooping."""
    steps = max(5, round(9 * shop.detail))
    t = np.linspace(0, 1, steps)
    half = width / 2 * np.sin(np.pi * t**0.8) ** 0.9 + width * 0.02
    x, z = length * (t - droop * 0.25 * t**3), length * (0.7 * t - (0.55 + droop) * t**2)
    side = np.linspace(-1, 1, 5)
    points = np.empty((steps, 5, 3))
    points[..., 0] = x[:, None]
    points[..., 1] = half[:, None] * side
    points[..., 2] = z[:, None] + 0.4 * half[:, None] * np.abs(side)
    return sheet(points, 0.002)


def plant(shop: Workshop) -> Item:
    """Leafy plant in a pot."""
    radius, height = shop.between(0.13, 0.18), shop.between(0.25, 0.35)
    leaves = []
    count = int(shop.rng.integers(14, 24))
    for k in range(count):
        length = shop.between(0.35, 0.7)
        one = leaf(shop, length, length * shop.between(0.16, 0.26), shop.between(0.0, 0.35))
        pitch = -shop.between(5, 55)
        leaves.append(one.at(z=height * 0.9, turn=137.5 * k, roll=pitch))
    return clutter("plant", pot(shop, radius, height), *leaves)


def small_tree(shop: Workshop) -> Item:
    """Rubber-tree-like plant: a bent stem with leaves along it."""
    stem = _stem(shop)
    leaves = []
    for k, at in enumerate(np.linspace(0.3, 1.0, 26)):
        x, y, z = stem[int(at * (len(stem) - 1))]
        one = leaf(shop, shop.between(0.22, 0.36), 0.12, shop.between(0.2, 0.7))
        leaves.append(one.at(x, y, z, turn=137.5 * k, roll=-shop.between(0, 50)))
    thick = np.linspace(0.02, 0.007, len(stem))
    return clutter("small_tree", pot(shop, 0.18, 0.32), shop.tube(stem, thick), *leaves)


def _stem(shop: Workshop) -> Floats:
    bends = [(0.0, 0.0, 0.28)]
    for z in (0.6, 0.95, 1.3, shop.between(1.5, 1.75)):
        x, y, _ = bends[-1]
        bends.append((x + shop.between(-0.07, 0.07), y + shop.between(-0.07, 0.07), z))
    return shop.smooth(bends)


def cactus(shop: Workshop) -> Item:
    """Cactus of superquadric segments in a small pot."""
    trunk = shop.superquadric((0.07, 0.07, 0.3), (0.6, 1.0)).at(z=0.45)
    arm = shop.superquadric((0.04, 0.04, 0.14), (0.6, 1.0))
    arms = [arm.at(0.12, 0, 0.6), arm.at(-0.12, 0, 0.5)]
    joints = [shop.rod((0, 0, z), (x, 0, z), 0.03) for x, z in ((0.12, 0.5), (-0.12, 0.4))]
    return clutter("cactus", pot(shop, 0.11, 0.18), trunk, *arms, *joints)
