from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pointkit.geometry.cloud import Floats, Ints
from pointkit.geometry.mesh import Primitive


@dataclass(frozen=True)
class Shape:
    """A geometric primitive in its standard pose: plane z = 0, axis along z, centre or apex at 0.

    Parameters
    ----------
    kind
        Kind of the primitive, as in `pointkit.geometry.mesh.Primitive`.
    lengths
        Radii or half axes, which scale with the pose.
    ratios
        Angles or exponents, which do not scale.
    """

    kind: str
    lengths: tuple[float, ...] = ()
    ratios: tuple[float, ...] = ()


PLANE = Shape("plane")
FREEFORM = Shape("freeform")


@dataclass(frozen=True)
class Surface:
    """Triangles that lie on s geometric primitives, such as the surface of a box on six planes.

    Parameters
    ----------
    vertices
        Vertices, (v, 3).
    triangles
        Indices of each triangle's vertices, counter-clockwise seen from outside, (t, 3).
    shape_id
        Index of each triangle's primitive in `shapes`, (t,).
    shapes
        The primitives, in their normal poses.
    frames
        Pose of each primitive, (s, 4, 4): rotation, translation and uniform scale.
    """

    vertices: Floats
    triangles: Ints
    shape_id: Ints
    shapes: tuple[Shape, ...]
    frames: Floats

    def __add__(self, other: Surface) -> Surface:
        return join([self, other])

    def transformed(self, pose: Floats) -> Surface:
        """Return the surface after a similarity transform, (4, 4).

        Triangles still face outwards after a reflection.
        """
        flip = float(np.linalg.det(pose[:3, :3])) < 0
        return replace(
            self,
            vertices=self.vertices @ pose[:3, :3].T + pose[:3, 3],
            triangles=self.triangles[:, ::-1] if flip else self.triangles,
            frames=pose @ self.frames,
        )

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, **angles: float) -> Surface:
        """Return the surface after the transform that `pose` makes from the same arguments."""
        return self.transformed(pose(x, y, z, **angles))

    def at_corners(self, x: float, y: float, z: float = 0.0) -> list[Surface]:
        """Return copies at (-x, -y), (-x, y), (x, -y) and (x, y)."""
        return [self.at(a * x, b * y, z) for a in (-1, 1) for b in (-1, 1)]

    def at_sides(
        self, x: float = 0.0, y: float = 0.0, z: float = 0.0, *, axis: int = 0, **angles: float
    ) -> list[Surface]:
        """Return two copies on opposite sides, rotated by `angles` as in the function `pose`.

        The second copy is at (x, y, z). The first is at the same position with the coordinate of
        number `axis` negated.
        """
        place = [-value if number == axis else value for number, value in enumerate((x, y, z))]
        return [self.at(*place, **angles), self.at(x, y, z, **angles)]

    def mirrored(self, axis: int = 0) -> Surface:
        """Return the reflection in the plane x = 0, y = 0 or z = 0 (`axis` 0, 1 or 2)."""
        mirror = np.eye(4)
        mirror[axis, axis] = -1.0
        return self.transformed(mirror)

    def flipped(self) -> Surface:
        """Return the surface facing the other way, for example as the inside of a room."""
        planes = np.array([shape.kind == "plane" for shape in self.shapes], dtype=bool)
        frames = self.frames.copy()
        frames[planes] = frames[planes] @ np.diag([1.0, -1.0, -1.0, 1.0])
        return replace(self, triangles=self.triangles[:, ::-1], frames=frames)

    def deformed(self, change: Callable[[Floats], Floats]) -> Surface:
        """Return a freeform surface whose vertices are ``change(vertices)``.

        Parameters
        ----------
        change
            Function that maps vertices (v, 3) to new vertices (v, 3).
        """
        return freeform(change(self.vertices), self.triangles)

    def select(self, *shapes: int) -> Surface:
        """Return the part that lies on the primitives with these indices in `shapes`."""
        rows = np.isin(self.shape_id, shapes)
        return replace(self, triangles=self.triangles[rows], shape_id=self.shape_id[rows])

    def bounds(self) -> Floats:
        """Return the lowest and highest corner of the bounding box, (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


def join(surfaces: list[Surface]) -> Surface:
    """Merge several surfaces into one, in their order."""
    vertices, shapes = 0, 0
    triangles, shape_ids = [], []
    for each in surfaces:
        triangles.append(each.triangles + vertices)
        shape_ids.append(each.shape_id + shapes)
        vertices, shapes = vertices + len(each.vertices), shapes + len(each.shapes)
    return Surface(
        np.concatenate([each.vertices for each in surfaces]),
        np.concatenate(triangles),
        np.concatenate(shape_ids),
        tuple(shape for each in surfaces for shape in each.shapes),
        np.concatenate([each.frames for each in surfaces]),
    )


def pose(
    x: float = 0.0,
    y: float = 0.0,
    z: float = 0.0,
    *,
    turn: float = 0.0,
    tilt: float = 0.0,
    roll: float = 0.0,
    scale: float = 1.0,
) -> Floats:
    """Return a similarity transform as a matrix (4, 4).

    The transform scales by `scale`, then rotates about y by `roll`, about x by `tilt` and about z
    by `turn`, and then moves by (x, y, z). Angles are in degrees, counter-clockwise.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation(2, turn) @ rotation(0, tilt) @ rotation(1, roll)
    matrix[:3, 3] = x, y, z
    return matrix


def rotation(axis: int, degrees: float) -> Floats:
    """Return the matrix (3, 3) of a rotation about the axis x, y or z (`axis` 0, 1 or 2)."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[[first, second], [first, second]] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix


def frame_along(axis: Floats, origin: Floats) -> Floats:
    """Return a pose, (4, 4), whose z axis has the direction of `axis` and whose origin is given."""
    z = axis / np.linalg.norm(axis)
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :4] = np.column_stack([x, np.cross(z, x), z, origin])
    return matrix


def one_shape(
    vertices: Floats, triangles: Ints, shape: Shape, frame: Floats | None = None
) -> Surface:
    """Make a surface on one primitive; triangles without area are left out.

    Parameters
    ----------
    frame
        Pose of the primitive, (4, 4); by default the standard pose of its `Shape`.
    """
    a, b, c = vertices[triangles].swapaxes(0, 1)
    size = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    valid = triangles[size > 1e-12]
    frames = (np.eye(4) if frame is None else frame)[None]
    return Surface(vertices, valid, np.zeros(len(valid), dtype=np.int64), (shape,), frames)


def freeform(vertices: Floats, triangles: Ints) -> Surface:
    """Make a surface that lies on no particular primitive."""
    return one_shape(vertices, triangles, FREEFORM)


def planar(vertices: Floats, triangles: Ints) -> Surface:
    """Make a plane surface, whose plane is that of the largest triangle."""
    a, b, c = vertices[triangles].swapaxes(0, 1)
    doubled = np.cross(b - a, c - a)
    largest = int(np.argmax(np.sum(doubled**2, axis=1)))
    return one_shape(vertices, triangles, PLANE, frame_along(doubled[largest], a[largest]))


def grid(
    points: Floats,
    shape: Shape = FREEFORM,
    frame: Floats | None = None,
    *,
    closed: tuple[bool, bool] = (False, False),
) -> Surface:
    """Make a surface through a grid of points.

    Parameters
    ----------
    points
        The grid, (rows, columns, 3). The surface faces to where the cross product of the direction
        from row to row and of that from column to column points.
    shape, frame
        Primitive on which the surface lies, and its pose.
    closed
        Whether the last row is connected to the first, and the last column to the first.
    """
    rows, columns, _ = points.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    index = np.vstack([index, index[:1]]) if closed[0] else index
    index = np.hstack([index, index[:, :1]]) if closed[1] else index
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return one_shape(points.reshape(-1, 3), triangles, shape, frame)


_PARAMETERS = {
    "cylinder": ("point", "axis", "radius"),
    "cone": ("apex", "axis", "half_angle"),
    "torus": ("centre", "axis", "major_radius", "minor_radius"),
}
"""Parameter names of position, direction, lengths and ratios."""


def primitive(shape: Shape, frame: Floats) -> Primitive:
    """Return a shape at a pose, (4, 4), as a primitive with its parameters by name."""
    scale = float(np.cbrt(abs(np.linalg.det(frame[:3, :3]))))
    axes, origin = frame[:3, :3] / scale, frame[:3, 3]
    point, axis = origin.tolist(), axes[:, 2].tolist()
    lengths = [length * scale for length in shape.lengths]
    parameters: dict[str, Any] = {}
    if shape.kind == "plane":
        parameters = {"normal": axis, "offset": float(axes[:, 2] @ origin)}
    elif shape.kind == "sphere":
        parameters = {"centre": point, "radius": lengths[0]}
    elif shape.kind == "superquadric":
        parameters = {"centre": point, "axes": axes.T.tolist(), "sizes": lengths}
        parameters["exponents"] = list(shape.ratios)
    elif shape.kind != "freeform":
        values = (point, axis, *lengths, *shape.ratios)
        parameters = dict(zip(_PARAMETERS[shape.kind], values, strict=True))
    return Primitive(shape.kind, parameters)
