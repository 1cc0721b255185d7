from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Primitive

Parameters = dict[str, Any]


def distances_to_primitive(primitive: Primitive, points: Floats) -> Floats:
    """Return the distances of points to the surface of a geometric primitive.

    Parameters
    ----------
    primitive
        Plane, cylinder, sphere or cone, which is taken as unbounded.
    points
        Points (n, 3) in the coordinates of the primitive.

    Returns
    -------
    numpy.ndarray
        Distances (n,) >= 0.
    """
    return np.abs(_DISTANCES[primitive.kind](primitive.parameters, points))


def parameter_differences(true: Primitive, decoded: Primitive, centre: Floats) -> dict[str, float]:
    """Return how much the parameters of a decoded primitive differ from the true ones.

    Parameters
    ----------
    true, decoded
        Two primitives of the same kind, in metres.
    centre
        Point (3,) near which the positions of planes and cylinder axes are compared.

    Returns
    -------
    dict
        As far as the kind has them:

        * ``angle_deg``: angle between the normals or axes.
        * ``position_m``: distance between the planes or axes near `centre`, or between the centres
          of spheres or apexes of cones.
        * ``radius_m``: difference of the radii.
        * ``half_angle_deg``: difference of the cones' half angles.
    """
    a, b, kind = true.parameters, decoded.parameters, true.kind
    direction = "normal" if kind == "plane" else "axis"
    values = {"angle_deg": _angle_deg(a[direction], b[direction])} if direction in a else {}
    if kind == "plane":
        values["position_m"] = abs(float(np.dot(b["normal"], centre)) - b["offset"])
    elif kind == "cylinder":
        axis = np.asarray(a["axis"])
        middle = np.asarray(a["point"]) + ((centre - a["point"]) @ axis) * axis
        values["position_m"] = float(_along_and_across(b["point"], b["axis"], middle[None])[1][0])
    else:
        place = "centre" if kind == "sphere" else "apex"
        values["position_m"] = float(np.linalg.norm(np.asarray(a[place]) - np.asarray(b[place])))
    if "radius" in a:
        values["radius_m"] = abs(a["radius"] - b["radius"])
    if "half_angle" in a:
        values["half_angle_deg"] = float(np.degrees(abs(a["half_angle"] - b["half_angle"])))
    return values


def _to_plane(plane: Parameters, points: Floats) -> Floats:
    return np.asarray(points @ np.asarray(plane["normal"]) - plane["offset"])


def _to_sphere(sphere: Parameters, points: Floats) -> Floats:
    away = np.linalg.norm(points - np.asarray(sphere["centre"]), axis=1)
    return np.asarray(away - sphere["radius"])


def _to_cylinder(cylinder: Parameters, points: Floats) -> Floats:
    _, across = _along_and_across(cylinder["point"], cylinder["axis"], points)
    return np.asarray(across - cylinder["radius"])


def _to_cone(cone: Parameters, points: Floats) -> Floats:
    """Return signed distances (n,) to a cone's surface; behind the apex, distances to the apex."""
    along, across = _along_and_across(cone["apex"], cone["axis"], points)
    cosine, sine = np.cos(cone["half_angle"]), np.sin(cone["half_angle"])
    past = along * cosine + across * sine < 0
    return np.asarray(np.where(past, np.hypot(along, across), across * cosine - along * sine))


def _along_and_across(place: Any, axis: Any, points: Floats) -> tuple[Floats, Floats]:
    offset = points - np.asarray(place)
    along = offset @ np.asarray(axis)
    return along, np.linalg.norm(offset - along[:, None] * np.asarray(axis), axis=1)


def _angle_deg(a: Any, b: Any) -> float:
    across = float(np.linalg.norm(np.cross(a, b)))
    return float(np.degrees(np.arctan2(across, abs(float(np.dot(a, b))))))


_DISTANCES: dict[str, Callable[[Parameters, Floats], Floats]] = {
    "plane": _to_plane,
    "cylinder": _to_cylinder,
    "sphere": _to_sphere,
    "cone": _to_cone,
}
COMPARABLE = tuple(_DISTANCES)
"""Kinds with comparable parameters; other primitives are matched by their points only."""
