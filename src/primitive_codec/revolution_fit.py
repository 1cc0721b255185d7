"""Robust least-squares fit of a surface of revolution to samples.

Levenberg-Marquardt steps minimise the sum of the losses sqrt(1 + z) - 1 of all samples, where z is
(distance / `loss_scale`)^2.
"""

from __future__ import annotations

import numpy as np

from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cholesky import solve
from pointkit.geometry.cloud import Floats
from primitive_codec.revolution import (
    SPHERE,
    RevolutionSurface,
    distance_to,
    normal_at,
    orthogonal_axes,
)
from primitive_codec.vectors import add_multiple, dot, length, row_of, vector

_MAX_STEPS = 15
_DAMPING, _DAMPING_STEP = 1e-3, 10.0
_MAX_DAMPING = 1e6
_MIN_RELATIVE_GAIN = 1e-6
"""Relative decrease of the loss below which the fit has converged."""
_UNKNOWN_COUNT = 6


@compiled
def fit_revolution(surface: RevolutionSurface, xyz: Floats, loss_scale: float) -> RevolutionSurface:
    """Fit a surface of revolution to points by robust least squares.

    Parameters
    ----------
    surface
        Surface with which the fit starts. The fit moves the origin of a cylinder or cone only
        perpendicularly to the axis; therefore the origin should be beside the points.
    xyz
        Coordinates (n, 3).
    loss_scale
        Distance above which a point counts as an outlier and has less weight.

    Returns
    -------
    RevolutionSurface
        The fitted surface, with the ends of the initial one.
    """
    current = (np.empty((_UNKNOWN_COUNT, _UNKNOWN_COUNT)), np.empty(_UNKNOWN_COUNT))
    trial = (np.empty((_UNKNOWN_COUNT, _UNKNOWN_COUNT)), np.empty(_UNKNOWN_COUNT))
    factor, step = np.empty((_UNKNOWN_COUNT, _UNKNOWN_COUNT)), np.empty(_UNKNOWN_COUNT)
    perpendicular = orthogonal_axes(surface.axis)
    loss = _linearise(surface, perpendicular, xyz, loss_scale, current[0], current[1])
    damping = _DAMPING
    for _ in range(_MAX_STEPS):
        _solve(current[0], current[1], damping, factor, step)
        candidate = _take_step(surface, perpendicular, step)
        candidate_perpendicular = orthogonal_axes(candidate.axis)
        trial_loss = _linearise(
            candidate, candidate_perpendicular, xyz, loss_scale, trial[0], trial[1]
        )
        if trial_loss < loss:
            gain = (loss - trial_loss) / loss
            surface, perpendicular, loss = candidate, candidate_perpendicular, trial_loss
            current, trial = trial, current
            damping /= _DAMPING_STEP
            if gain < _MIN_RELATIVE_GAIN:
                break
        else:
            damping *= _DAMPING_STEP
            if damping > _MAX_DAMPING:
                break
    return surface


@compiled
def _linearise(
    surface: RevolutionSurface,
    perpendicular: tuple[Floats, Floats],
    xyz: Floats,
    loss_scale: float,
    matrix: Floats,
    gradient: Floats,
) -> float:
    """Write the weighted normal equations, (6, 6) and (6,), of a step, and return the loss."""
    # Unknowns are the origin's displacements along both perpendicular axes, the axis's tilts
    # towards them, radius, and angle; for a sphere, three displacements and the radius.
    matrix[:], gradient[:] = 0.0, 0.0
    jacobian = np.empty(_UNKNOWN_COUNT)
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    origin, axis = vector(surface.origin), vector(surface.axis)
    u, v = vector(perpendicular[0]), vector(perpendicular[1])
    loss = 0.0
    for i in range(len(xyz)):
        distance, height, radius = distance_to(surface, sine, cosine, xyz[i])
        radial = add_multiple(row_of(xyz, i), -1.0, origin)
        normal = normal_at(surface, sine, cosine, radial, height, radius)
        if surface.kind == SPHERE:
            jacobian[2], jacobian[3], jacobian[4], jacobian[5] = -dot(axis, normal), 0.0, -1.0, 0.0
        else:
            tilt = -(cosine * height / max(radius, 1e-9) + sine)
            jacobian[2], jacobian[3] = tilt * dot(radial, u), tilt * dot(radial, v)
            jacobian[4] = -cosine
            jacobian[5] = -(radius - surface.radius) * sine - height * cosine
        jacobian[0], jacobian[1] = -dot(u, normal), -dot(v, normal)
        root = np.sqrt(1 + (distance / loss_scale) ** 2)
        loss += root - 1
        for k in range(_UNKNOWN_COUNT):
            gradient[k] += jacobian[k] * distance / root
            for j in range(k + 1):
                matrix[k, j] += jacobian[k] * jacobian[j] / root
    return loss


@compiled_in_place
def _solve(matrix: Floats, gradient: Floats, damping: float, factor: Floats, step: Floats) -> None:
    for k in range(_UNKNOWN_COUNT):
        step[k] = -gradient[k]
        for j in range(k):
            factor[k, j] = matrix[k, j]
        factor[k, k] = matrix[k, k] * (1 + damping) if matrix[k, k] > 0 else 1.0
    solve(factor, step, 1e-12)


@compiled
def _take_step(
    surface: RevolutionSurface, perpendicular: tuple[Floats, Floats], step: Floats
) -> RevolutionSurface:
    origin = surface.origin + step[0] * perpendicular[0] + step[1] * perpendicular[1]
    axis, angle = surface.axis, surface.angle
    if surface.kind == SPHERE:
        origin = origin + step[2] * axis
    else:
        axis = axis + step[2] * perpendicular[0] + step[3] * perpendicular[1]
        axis = axis / length(vector(axis))
        angle += step[5]
    radius = surface.radius + step[4]
    ends = (surface.first_row, surface.row_count)
    return RevolutionSurface(surface.kind, origin, axis, radius, angle, *ends)
