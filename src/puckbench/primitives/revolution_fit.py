"""Robust least-squares fit of a surface of revolution to samples.

Steps of Levenberg and Marquardt, reweighted for the loss sqrt(1 + z) - 1 of z, the squared distance
in scales. All is compiled here: the results of libraries of linear algebra depend on the processor.
"""

from __future__ import annotations

import numpy as np

from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats
from puckbench.geometry.vectors import add_multiple, dot, length, row_of, vector
from puckbench.primitives.revolution import (
    SPHERE,
    RevolutionSurface,
    distance_to,
    normal_at,
    orthogonal_axes,
)

_MAX_STEPS = 15
_DAMPING, _DAMPING_STEP = 1e-3, 10.0
_MAX_DAMPING = 1e6
_MIN_GAIN = 1e-6
"""Share of the loss that a step must save for another one to follow."""
_UNKNOWNS = 6


@compiled
def fit_revolution(surface: RevolutionSurface, xyz: Floats, scale: float) -> RevolutionSurface:
    """Fit a surface to points.

    Parameters
    ----------
    surface
        Where to begin; its origin should be beside the points, since it moves across the axis alone
        (a sphere's in all directions).
    xyz
        (n, 3) points.
    scale
        Distance from which on a point counts for less than its square.
    """
    best = (np.empty((_UNKNOWNS, _UNKNOWNS)), np.empty(_UNKNOWNS))
    tried = (np.empty((_UNKNOWNS, _UNKNOWNS)), np.empty(_UNKNOWNS))
    factor, step = np.empty((_UNKNOWNS, _UNKNOWNS)), np.empty(_UNKNOWNS)
    across = orthogonal_axes(surface.axis)
    loss = _linearise(surface, across, xyz, scale, best[0], best[1])
    damping = _DAMPING
    for _ in range(_MAX_STEPS):
        _solve(best[0], best[1], damping, factor, step)
        candidate = _stepped(surface, across, step)
        across_it = orthogonal_axes(candidate.axis)
        found = _linearise(candidate, across_it, xyz, scale, tried[0], tried[1])
        if found < loss:
            gain = (loss - found) / loss
            surface, across, loss, best, tried = candidate, across_it, found, tried, best
            damping /= _DAMPING_STEP
            if gain < _MIN_GAIN:
                break
        else:
            damping *= _DAMPING_STEP
            if damping > _MAX_DAMPING:
                break
    return surface


@compiled
def _linearise(
    surface: RevolutionSurface,
    across: tuple[Floats, Floats],
    xyz: Floats,
    scale: float,
    matrix: Floats,
    gradient: Floats,
) -> float:
    """Write the weighted normal equations (6, 6) and (6,) of a step; the loss.

    Unknowns: origin along both axes across, their tilts (or a sphere's origin along its axis, and
    none), radius, angle.
    """
    matrix[:], gradient[:] = 0.0, 0.0
    slopes = np.empty(_UNKNOWNS)
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    origin, axis = vector(surface.origin), vector(surface.axis)
    u, v = vector(across[0]), vector(across[1])
    loss = 0.0
    for i in range(len(xyz)):
        distance, height, radius = distance_to(surface, sine, cosine, xyz[i])
        out = add_multiple(row_of(xyz, i), -1.0, origin)
        normal = normal_at(surface, sine, cosine, out, height, radius)
        if surface.kind == SPHERE:
            slopes[2], slopes[3], slopes[4], slopes[5] = -dot(axis, normal), 0.0, -1.0, 0.0
        else:
            tilt = -(cosine * height / max(radius, 1e-9) + sine)
            slopes[2], slopes[3] = tilt * dot(out, u), tilt * dot(out, v)
            slopes[4] = -cosine
            slopes[5] = -(radius - surface.radius) * sine - height * cosine
        slopes[0], slopes[1] = -dot(u, normal), -dot(v, normal)
        root = np.sqrt(1 + (distance / scale) ** 2)
        loss += root - 1
        for k in range(_UNKNOWNS):
            gradient[k] += slopes[k] * distance / root
            for j in range(k + 1):
                matrix[k, j] += slopes[k] * slopes[j] / root
    return loss


@compiled_in_place
def _solve(matrix: Floats, gradient: Floats, damping: float, factor: Floats, step: Floats) -> None:
    """Write the step (6,) that solves damped normal equations, by Cholesky's factors (6, 6)."""
    for k in range(_UNKNOWNS):
        for j in range(k + 1):
            left = matrix[k, j]
            if j == k:
                left = left * (1 + damping) if left > 0 else 1.0
            for i in range(j):
                left -= factor[k, i] * factor[j, i]
            factor[k, j] = np.sqrt(max(left, 1e-12)) if j == k else left / factor[j, j]
    for k in range(_UNKNOWNS):
        left = -gradient[k]
        for i in range(k):
            left -= factor[k, i] * step[i]
        step[k] = left / factor[k, k]
    for k in range(_UNKNOWNS - 1, -1, -1):
        left = step[k]
        for i in range(k + 1, _UNKNOWNS):
            left -= factor[i, k] * step[i]
        step[k] = left / factor[k, k]


@compiled
def _stepped(
    surface: RevolutionSurface, across: tuple[Floats, Floats], step: Floats
) -> RevolutionSurface:
    """A surface after a step of the unknowns of `_linearise`."""
    origin = surface.origin + step[0] * across[0] + step[1] * across[1]
    axis, angle = surface.axis, surface.angle
    if surface.kind == SPHERE:
        origin = origin + step[2] * axis
    else:
        axis = axis + step[2] * across[0] + step[3] * across[1]
        axis = axis / length(vector(axis))
        angle += step[5]
    radius = surface.radius + step[4]
    rows = (surface.first_row, surface.rows)
    return RevolutionSurface(surface.kind, origin, axis, radius, angle, *rows)
