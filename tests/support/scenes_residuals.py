"""How far points are from primitives, written down from the primitives' equations."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh, Primitive

Numbers = list[float]


def _along_and_across(
    points: Floats, origin: list[float], axis: list[float]
) -> tuple[Floats, Floats]:
    relative = points - np.array(origin)
    along = relative @ np.array(axis)
    across = np.linalg.norm(relative - along[:, None] * np.array(axis), axis=1)
    return along, across


def residual(primitive: Primitive, points: Floats) -> Floats:
    """Distance (or, for superquadrics, radial distance) of points (n, 3) to a primitive, (n,)."""
    return np.asarray(_RESIDUALS[primitive.kind](points, **primitive.parameters))


def _plane(points: Floats, normal: Numbers, offset: float) -> Floats:
    return points @ np.array(normal) - offset


def _cylinder(points: Floats, point: Numbers, axis: Numbers, radius: float) -> Floats:
    return _along_and_across(points, point, axis)[1] - radius


def _sphere(points: Floats, centre: Numbers, radius: float) -> Floats:
    return np.asarray(np.linalg.norm(points - np.array(centre), axis=1) - radius)


def _cone(points: Floats, apex: Numbers, axis: Numbers, half_angle: float) -> Floats:
    along, across = _along_and_across(points, apex, axis)
    return np.asarray(np.cos(half_angle) * across - np.sin(half_angle) * along)


def _torus(
    points: Floats, centre: Numbers, axis: Numbers, major_radius: float, minor_radius: float
) -> Floats:
    along, across = _along_and_across(points, centre, axis)
    return np.asarray(np.hypot(across - major_radius, along) - minor_radius)


def _superquadric(
    points: Floats, centre: Numbers, axes: list[Numbers], sizes: Numbers, exponents: Numbers
) -> Floats:
    local = np.abs((points - np.array(centre)) @ np.array(axes).T)
    x, y, z = (local / np.array(sizes)).T
    e1, e2 = exponents
    value = (x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1)
    return np.asarray((value ** (e1 / 2) - 1) * min(sizes))


_RESIDUALS: dict[str, Callable[..., Floats]] = {
    "plane": _plane,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "cone": _cone,
    "torus": _torus,
    "superquadric": _superquadric,
    "freeform": lambda points: np.zeros(len(points)),
}


def worst_residual(mesh: Mesh) -> float:
    """Largest distance of any triangle's corner to the triangle's primitive."""
    assert mesh.labels is not None
    order = np.argsort(mesh.labels.primitive_id, kind="stable")
    ids = mesh.labels.primitive_id[order]
    starts = np.flatnonzero(np.diff(ids, prepend=-1))
    worst = 0.0
    for rows in np.split(order, starts[1:]):
        primitive = mesh.labels.primitives[mesh.labels.primitive_id[rows[0]]]
        corners = mesh.vertices[np.unique(mesh.triangles[rows])]
        worst = max(worst, float(np.abs(residual(primitive, corners)).max()))
    return worst


def plane_alignment(mesh: Mesh) -> NDArray[np.float64]:
    """Cosine between a triangle's front and its plane's normal, for triangles on planes."""
    assert mesh.labels is not None
    kinds = np.array([item.kind == "plane" for item in mesh.labels.primitives])
    normals = np.array(
        [item.parameters.get("normal", (0, 0, 0)) for item in mesh.labels.primitives]
    )
    flat = kinds[mesh.labels.primitive_id]
    return np.sum(mesh.normals()[flat] * normals[mesh.labels.primitive_id[flat]], axis=1)


def volume(mesh: Mesh) -> float:
    """Enclosed volume by the divergence theorem: positive when fronts are outside."""
    a, b, c = mesh.corners().swapaxes(0, 1)
    return float(np.sum(a * np.cross(b, c)) / 6)


def assert_furniture_within(mesh: Mesh, low: Floats, high: Floats) -> None:
    """Everything in a room but the room itself lies in its box, to 2 cm."""
    assert mesh.labels is not None
    outside = ("wall", "door", "window", "skirting", "passage_end")
    loose = [i for i, item in enumerate(mesh.labels.objects) if not item.name.startswith(outside)]
    corners = mesh.corners()[np.isin(mesh.labels.object_id, loose)].reshape(-1, 3)
    assert (corners > low - 0.02).all()
    assert (corners < high + 0.02).all()
