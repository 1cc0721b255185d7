"""Distances of points to geometric primitives, and differences between two primitives of a kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Primitive

Parameters = dict[str, Any]


def distances(primitive: Primitive, points: Floats) -> Floats:
    """Distances (n,) of points (n, 3) to an unbounded plane, cylinder, sphere or cone."""
    return np.abs(_DISTANCES[primitive.kind](primitive.parameters, points))


def differences(true: Primitive, found: Primitive, centre: Floats) -> dict[str, float]:
    """Differences of the parameters of two primitives of one kind, in metres and degrees.

    Parameters
    ----------
    true, found
        The primitives.
    centre
        A point on the true one, (3,), at which planes and cylinders' axes are compared.

    Returns
    -------
    dict
        Of these the quantities that the kind has. ``angle_deg``: between normals or axes.
        ``position_m``: distance of the planes or axes at `centre`, of spheres' centres, of cones'
        apexes. ``radius_m`` and ``half_angle_deg``: absolute differences.
    """
    return _DIFFERENCES[true.kind](true.parameters, found.parameters, centre)


def _to_plane(plane: Parameters, points: Floats) -> Floats:
    return np.asarray(points @ np.asarray(plane["normal"]) - plane["offset"])


def _to_sphere(sphere: Parameters, points: Floats) -> Floats:
    away = np.linalg.norm(points - np.asarray(sphere["centre"]), axis=1)
    return np.asarray(away - sphere["radius"])


def _to_cylinder(cylinder: Parameters, points: Floats) -> Floats:
    _, across = _along_and_across(cylinder["point"], cylinder["axis"], points)
    return np.asarray(across - cylinder["radius"])


def _to_cone(cone: Parameters, points: Floats) -> Floats:
    """To the nappe along the axis; beyond the apex, to the apex."""
    along, across = _along_and_across(cone["apex"], cone["axis"], points)
    cosine, sine = np.cos(cone["half_angle"]), np.sin(cone["half_angle"])
    past = along * cosine + across * sine < 0
    return np.asarray(np.where(past, np.hypot(along, across), across * cosine - along * sine))


def _along_and_across(place: Any, axis: Any, points: Floats) -> tuple[Floats, Floats]:
    """Coordinates of points along an axis and their distances from it."""
    offset = points - np.asarray(place)
    along = offset @ np.asarray(axis)
    return along, np.linalg.norm(offset - along[:, None] * np.asarray(axis), axis=1)


def _angle_deg(one: Any, other: Any) -> float:
    """Angle between two unit vectors of any sign; exact where it is small."""
    across = float(np.linalg.norm(np.cross(one, other)))
    return float(np.degrees(np.arctan2(across, abs(float(np.dot(one, other))))))


def _apart(one: Any, other: Any) -> float:
    return float(np.linalg.norm(np.asarray(one) - np.asarray(other)))


def _of_planes(true: Parameters, found: Parameters, centre: Floats) -> dict[str, float]:
    off = float(np.dot(found["normal"], centre)) - found["offset"]
    return {"angle_deg": _angle_deg(true["normal"], found["normal"]), "position_m": abs(off)}


def _of_spheres(true: Parameters, found: Parameters, _: Floats) -> dict[str, float]:
    radius = abs(true["radius"] - found["radius"])
    return {"position_m": _apart(true["centre"], found["centre"]), "radius_m": radius}


def _of_cylinders(true: Parameters, found: Parameters, centre: Floats) -> dict[str, float]:
    axis = np.asarray(true["axis"])
    middle = np.asarray(true["point"]) + ((centre - true["point"]) @ axis) * axis
    _, across = _along_and_across(found["point"], found["axis"], middle[None])
    return {
        "angle_deg": _angle_deg(true["axis"], found["axis"]),
        "position_m": float(across[0]),
        "radius_m": abs(true["radius"] - found["radius"]),
    }


def _of_cones(true: Parameters, found: Parameters, _: Floats) -> dict[str, float]:
    half_angle = abs(true["half_angle"] - found["half_angle"])
    return {
        "angle_deg": _angle_deg(true["axis"], found["axis"]),
        "position_m": _apart(true["apex"], found["apex"]),
        "half_angle_deg": float(np.degrees(half_angle)),
    }


_DISTANCES: dict[str, Callable[[Parameters, Floats], Floats]] = {
    "plane": _to_plane,
    "cylinder": _to_cylinder,
    "sphere": _to_sphere,
    "cone": _to_cone,
}
_DIFFERENCES: dict[str, Callable[[Parameters, Parameters, Floats], dict[str, float]]] = {
    "plane": _of_planes,
    "cylinder": _of_cylinders,
    "sphere": _of_spheres,
    "cone": _of_cones,
}
COMPARABLE = tuple(_DIFFERENCES)
"""Kinds whose parameters are compared; the others are matched by their points alone."""
