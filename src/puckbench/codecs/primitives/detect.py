"""Finds cylinders, cones and spheres among the samples of a surface that is not flat."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives.layout import Ints
from puckbench.codecs.primitives.revolved import CONE, SPHERE, Round, across, cross
from puckbench.core.environment import allowed_threads
from puckbench.geometry.cloud import Floats

_SEEDS = 300
_SCORED = 1200
_FITTED = 400
_MOST = 16
_TRIED = 24
_LEAST_CURVED = 0.03
"""Share of the samples that have to lie where a surface bends."""
_FEWEST = 48
"""Samples that a surface explains at least."""
_COVERED = 0.35
"""Share of the cells between a surface's ends that have to hold samples."""
_CURVED = (0.8, 0.985)
"""Cosines of the angle between neighbours' normals where a surface is round, not flat, no edge."""
_NORMALS = 0.96
_SPANS = (3.0, 6.0, 12.0)
"""Distances of the samples that a hypothesis is made of, in sample cells."""

Mask = NDArray[np.bool_]


def detected(xyz: Floats, normals: Floats, cell: float, tolerance: float) -> list[Round]:
    """Surfaces of revolution that explain many samples (n, 3) to `tolerance`, the largest first.

    cell: spacing of the samples. Deterministic: samples are taken at equal steps.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(xyz)
    curved = _curved(tree, xyz, normals, cell)
    if len(curved) < max(_FEWEST, _LEAST_CURVED * len(xyz)):
        return []
    scored = curved[:: -(-len(curved) // _SCORED)]
    guesses = _guesses(tree, xyz, normals, curved[:: -(-len(curved) // _SEEDS)], cell, tolerance)
    held = [_held(guess, xyz[scored], normals[scored], tolerance) for guess in guesses]
    if not held:
        return []
    return _chosen(guesses, np.stack(held), xyz, normals, cell, tolerance)


def explained(surface: Round, xyz: Floats, normals: Floats, tolerance: float) -> Mask:
    """Which samples lie on a surface between its ends."""
    held = _held(surface, xyz, normals, tolerance)
    along = surface.coordinates(xyz[held])[0]
    held[held] = (along >= surface.first - 1) & (along <= surface.first + surface.rows + 1)
    return held


def _curved(tree: Any, xyz: Floats, normals: Floats, cell: float) -> Ints:
    """Samples whose normal differs from that of a sample near by, less than at an edge."""
    within = {"k": min(24, len(xyz)), "distance_upper_bound": _SPANS[0] * cell}
    near = tree.query(xyz, **within, workers=allowed_threads())[1]
    held = np.concatenate([normals, np.full((1, 3), np.nan)])[near]
    cosine = np.abs(np.einsum("ikj,ij->ik", held, normals))
    return np.flatnonzero(((cosine > _CURVED[0]) & (cosine < _CURVED[1])).any(axis=1))


def _guesses(
    tree: Any, xyz: Floats, normals: Floats, seeds: Ints, cell: float, tolerance: float
) -> list[Round]:
    """Surfaces through two or three samples and their normals."""
    made: list[Round] = []
    largest = float(np.ptp(xyz, axis=0).max()) / 2
    for k, span in enumerate(_SPANS):
        for row, near in zip(seeds, tree.query_ball_point(xyz[seeds], span * cell), strict=True):
            others = np.array(near)
            away = np.linalg.norm(xyz[others] - xyz[row], axis=1)
            others = others[away > 0.6 * span * cell]
            if len(others) < 2:
                continue
            rows = np.array([row, others[(7 * k + 3) % len(others)], others[len(others) // 2]])
            sides = np.where(normals[rows] @ normals[row] < 0, -1.0, 1.0)
            made += _through(xyz[rows], normals[rows] * sides[:, None], tolerance)
    return [guess for guess in made if tolerance < guess.radius < largest]


def _through(xyz: Floats, normals: Floats, tolerance: float) -> list[Round]:
    """The sphere and cylinder through the first two samples, the cone through three."""
    made = []
    bend, apart = normals[0] - normals[1], xyz[0] - xyz[1]
    if bend @ bend < 1e-4:
        return []
    radius = float(apart @ bend / (bend @ bend))
    if np.linalg.norm(apart - radius * bend) < 2 * tolerance:
        made.append(_round(SPHERE, xyz[0] - radius * normals[0], np.eye(3)[2], abs(radius), 0.0))
    axis = cross(normals[0], normals[1])
    axis /= np.linalg.norm(axis)
    flat = apart - (apart @ axis) * axis
    radius = float(flat @ bend / (bend @ bend))
    if np.linalg.norm(flat - radius * bend) < 2 * tolerance:
        made.append(_round(CONE, xyz[0] - radius * normals[0], axis, abs(radius), 0.0))
    return made + _cone(xyz, normals)


def _cone(xyz: Floats, normals: Floats) -> list[Round]:
    axis = cross(normals[0] - normals[1], normals[0] - normals[2])
    if np.linalg.norm(axis) < 0.02 or abs(np.linalg.det(normals)) < 1e-3:
        return []
    axis /= np.linalg.norm(axis)
    apex = np.linalg.solve(normals, np.einsum("ij,ij->i", normals, xyz))
    middle = xyz.mean(axis=0)
    axis = axis if (middle - apex) @ axis > 0 else -axis
    height = float((middle - apex) @ axis)
    radius = float(np.linalg.norm(middle - apex - height * axis))
    angle = float(np.arctan2(radius, height))
    if not 0.02 < angle < 1.3:
        return []
    return [_round(CONE, apex + height * axis, axis, radius, angle)]


def _round(kind: int, origin: Floats, axis: Floats, radius: float, angle: float) -> Round:
    return Round(kind, origin, axis, radius, angle, 0, 0)


def _held(surface: Round, xyz: Floats, normals: Floats, tolerance: float) -> Mask:
    """Which samples lie on a surface, wherever it ends, with its normal."""
    near = np.flatnonzero(np.abs(surface.distances(xyz)) < tolerance)
    own = surface.coordinates(xyz[near])[3]
    held = np.zeros(len(xyz), bool)
    held[near] = np.abs(np.einsum("ij,ij->i", own, normals[near])) > _NORMALS
    return held


def _chosen(
    guesses: list[Round],
    held: Mask,
    xyz: Floats,
    normals: Floats,
    cell: float,
    tolerance: float,
) -> list[Round]:
    """Greedily the guesses that explain most of what is left, fitted to it."""
    left, free = np.ones(held.shape[1], bool), np.ones(len(xyz), bool)
    found: list[Round] = []
    for _ in range(_TRIED):
        counts = (held & left).sum(axis=1)
        best = int(counts.argmax())
        if len(found) == _MOST or counts[best] < 5:
            break
        left &= ~held[best]
        fitted = _fitted(guesses[best], xyz, normals, free, tolerance)
        fitted = bounded(fitted, xyz, normals, free, tolerance)
        rows = free & explained(fitted, xyz, normals, tolerance)
        if rows.sum() >= _FEWEST and _covered(fitted, xyz[rows], cell) > _COVERED:
            free &= ~rows
            found.append(fitted)
    return found


def _fitted(surface: Round, xyz: Floats, normals: Floats, free: Mask, tolerance: float) -> Round:
    """Least squares of the distances of the samples that a surface holds."""
    from scipy.optimize import least_squares

    for _ in range(2):
        rows = np.flatnonzero(free & _held(surface, xyz, normals, tolerance))
        if len(rows) < 12:
            return surface
        near = xyz[rows[:: -(-len(rows) // _FITTED)]]
        start, base = np.zeros(7), surface._replace(origin=_middle(surface, near))
        base = base._replace(radius=_radius_at(surface, base.origin))
        answer = least_squares(
            _distances, start, args=(base, near), loss="soft_l1", f_scale=tolerance / 2, max_nfev=15
        )
        surface = _changed(base, answer.x)
    return surface


def _distances(change: Floats, surface: Round, xyz: Floats) -> Floats:
    """Distances of points (n, 3) from a changed surface."""
    return _changed(surface, change).distances(xyz)


def _middle(surface: Round, near: Floats) -> Floats:
    """The foot of the samples' mean on the axis, or a sphere's centre."""
    if surface.kind == SPHERE:
        return surface.origin
    height = float((near.mean(axis=0) - surface.origin) @ surface.axis)
    return np.asarray(surface.origin + height * surface.axis)


def _radius_at(surface: Round, origin: Floats) -> float:
    height = float((origin - surface.origin) @ surface.axis)
    return surface.radius + height * float(np.tan(surface.angle))


def _changed(surface: Round, change: Floats) -> Round:
    """A surface with seven small changes: origin, axis (2), radius, angle."""
    if surface.kind == SPHERE:
        return surface._replace(
            origin=surface.origin + change[:3], radius=surface.radius + float(change[5])
        )
    u, v = across(surface.axis)
    axis = surface.axis + (change[3] * u + change[4] * v) / 100
    return surface._replace(
        origin=surface.origin + change[:3],
        axis=axis / np.linalg.norm(axis),
        radius=surface.radius + float(change[5]),
        angle=surface.angle + float(change[6]) / 100,
    )


def bounded(surface: Round, xyz: Floats, normals: Floats, free: Mask, tolerance: float) -> Round:
    """A surface with its ends where those of the free samples on it are; no rows for too few."""
    held = free & _held(surface, xyz, normals, tolerance)
    if held.sum() < _FEWEST / 2:
        return surface._replace(rows=0)
    low, high = np.quantile(surface.coordinates(xyz[held])[0], [0.01, 0.99])
    first = int(np.floor(low))
    return surface._replace(first=first, rows=min(int(np.ceil(high)) - first, 4000))


def _covered(surface: Round, xyz: Floats, cell: float) -> float:
    """Share of the patches of two sample cells between a surface's ends that hold samples."""
    along, turn, _, _ = surface.coordinates(xyz)
    size = 2 * max(cell, 1.0)
    radius = surface.profile(along)[0]
    rows = ((along - surface.first) / size).astype(np.int64)
    columns = (turn * radius / size).astype(np.int64)
    area = float(surface.columns().sum()) / size**2
    return len(np.unique(np.stack([rows, columns]), axis=1).T) / max(area, 1.0)
