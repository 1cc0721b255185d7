"""Pictures of meshes and clouds without a display: ray casting and depth-buffered splats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh

Image = NDArray[np.uint8]
Vector = tuple[float, float, float]

SEMANTIC_COLOURS: dict[str, tuple[int, int, int]] = {
    "ceiling": (232, 229, 220),
    "floor": (196, 178, 150),
    "wall": (214, 219, 224),
    "beam": (160, 140, 170),
    "column": (150, 160, 200),
    "window": (150, 205, 235),
    "door": (178, 128, 82),
    "table": (218, 165, 90),
    "chair": (214, 84, 80),
    "sofa": (150, 95, 190),
    "bookcase": (110, 150, 90),
    "board": (245, 245, 245),
    "clutter": (90, 155, 170),
}
PRIMITIVE_COLOURS: dict[str, tuple[int, int, int]] = {
    "plane": (200, 205, 212),
    "cylinder": (228, 120, 60),
    "sphere": (70, 130, 200),
    "cone": (80, 170, 110),
    "torus": (190, 90, 170),
    "superquadric": (220, 190, 70),
    "freeform": (150, 110, 90),
}
_PLAIN = (200, 196, 188)
_BACKGROUND = 255.0
_FAR = np.float32(np.inf)


@dataclass(frozen=True)
class View:
    """A camera. eye, target and up: (3,) in the scene's units.

    field_of_view_deg: vertical opening of a perspective camera. height: when given, the camera is
    orthographic and its picture is this high in the scene's units.
    """

    eye: Vector
    target: Vector
    up: Vector = (0.0, 0.0, 1.0)
    field_of_view_deg: float = 40.0
    height: float | None = None

    def axes(self) -> tuple[Floats, Floats, Floats]:
        """Unit vectors to the right, up and forward, each (3,)."""
        forward = _unit(np.subtract(self.target, self.eye))
        right = np.cross(forward, np.asarray(self.up, dtype=np.float64))
        if np.linalg.norm(right) < 1e-9:
            raise InputError("view: the up direction is along the line of sight")
        right = _unit(right)
        return right, np.cross(right, forward), forward

    def half_extent(self) -> float:
        """Half the picture's height, at distance 1 (perspective) or anywhere (orthographic)."""
        if self.height is not None:
            return self.height / 2
        return float(np.tan(np.radians(self.field_of_view_deg) / 2))

    def rays(self, width: int, height: int) -> tuple[Floats, Floats]:
        """Origins and unit directions of the pixels' rays, each (height, width, 3)."""
        right, up, forward = self.axes()
        half = self.half_extent()
        across = (np.arange(width) + 0.5 - width / 2) * (2 * half / height)
        upward = (height / 2 - np.arange(height) - 0.5) * (2 * half / height)
        plane = across[None, :, None] * right + upward[:, None, None] * up
        eye = np.asarray(self.eye, dtype=np.float64)
        if self.height is not None:
            return eye + plane, np.broadcast_to(forward, plane.shape)
        return np.broadcast_to(eye, plane.shape), _unit(plane + forward)

    def project(self, points: Floats, width: int, height: int) -> Floats:
        """Column, row and depth (along the line of sight) of points (n, 3), as (n, 3)."""
        right, up, forward = self.axes()
        local = (points - np.asarray(self.eye)) @ np.stack([right, up, forward], axis=1)
        depth = local[:, 2]
        scale = height / (2 * self.half_extent())
        reach = np.where(depth > 0, depth, np.nan) if self.height is None else 1.0
        columns = width / 2 + local[:, 0] * scale / reach
        rows = height / 2 - local[:, 1] * scale / reach
        return np.column_stack([columns, rows, depth])


def three_quarter_view(
    bounds: Floats,
    azimuth_deg: float = -60.0,
    elevation_deg: float = 32.0,
    aspect: float = 4 / 3,
    field_of_view_deg: float = 35.0,
) -> View:
    """Perspective view of a box (2, 3) from `azimuth_deg` about z and `elevation_deg` above it.

    The camera is as near as it can be with the whole box in a picture of the given aspect.
    """
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) * np.cos(elevation)
    direction[2] = np.sin(elevation)
    centre = np.mean(bounds, axis=0)
    corners = np.stack(np.meshgrid(*np.transpose(bounds), indexing="ij"), axis=-1).reshape(-1, 3)
    right, up, forward = View(_vector(centre + direction), _vector(centre)).axes()
    across, upward, ahead = ((corners - centre) @ axis for axis in (right, up, forward))
    tangent = np.tan(np.radians(field_of_view_deg) / 2)
    needed = np.maximum(np.abs(across) / aspect, np.abs(upward)) / tangent - ahead
    eye = centre + direction * (1.04 * needed.max())
    return View(_vector(eye), _vector(centre), field_of_view_deg=field_of_view_deg)


def top_view(bounds: Floats, aspect: float = 4 / 3) -> View:
    """Orthographic view of a box (2, 3) from straight above, x to the right and y upwards."""
    centre = np.mean(bounds, axis=0)
    size = np.subtract(bounds[1], bounds[0])
    eye = centre + np.array([0.0, 0.0, size[2] + size.max()])
    height = 1.04 * max(size[1], size[0] / aspect)
    return View(_vector(eye), _vector(centre), up=(0.0, 1.0, 0.0), height=float(height))


def triangle_colours(mesh: Mesh, by: str) -> Image:
    """Colours (t, 3) of a mesh's triangles by "object", "semantic" or "primitive"; "plain" grey."""
    plain = np.full((len(mesh.triangles), 3), _PLAIN, dtype=np.uint8)
    if by == "plain" or (mesh.labels is None and by in ("object", "semantic", "primitive")):
        return plain
    if mesh.labels is None or by not in ("object", "semantic", "primitive"):
        raise InputError(f"colours: expected plain, object, semantic or primitive, got {by!r}")
    labels = mesh.labels
    if by == "primitive":
        kinds = [PRIMITIVE_COLOURS.get(one.kind, _PLAIN) for one in labels.primitives]
        return np.array(kinds, dtype=np.uint8)[labels.primitive_id]
    semantic = [SEMANTIC_COLOURS.get(one.semantic, _PLAIN) for one in labels.objects]
    palette = np.array(semantic, dtype=np.float64)
    if by == "object":
        palette = _varied(palette)
    return palette.astype(np.uint8)[labels.object_id]


def render_mesh(
    mesh: Mesh,
    view: View,
    size: tuple[int, int] = (800, 600),
    colours: str | Image = "object",
    *,
    cull: bool = False,
    edges: bool = True,
    occlusion_rays: int = 10,
    samples: int = 2,
) -> Image:
    """Picture (height, width, 3) of a mesh by ray casting, soft shading and contact shadows.

    size: (width, height) in pixels. colours: "object", "semantic", "primitive", "plain", or
    (t, 3) uint8. cull: faces whose front is turned away from the camera are cut away, which opens
    the ceiling and the near walls of a room. edges: darker lines where depth or direction jumps.
    samples: rays per pixel along each axis. The same arguments give the same bytes.
    """
    palette = triangle_colours(mesh, colours) if isinstance(colours, str) else colours
    corners = mesh.corners() - np.asarray(view.eye)
    kept = np.flatnonzero(_facing(corners, view) if cull else np.ones(len(corners), dtype=bool))
    width, height = size[0] * samples, size[1] * samples
    origins, directions = view.rays(width, height)
    rays = np.concatenate([origins - np.asarray(view.eye), directions], axis=-1)
    picture = np.full((height, width, 3), _BACKGROUND)
    if len(kept):
        scene = _scene(corners[kept])
        hits = _cast(scene, rays.astype(np.float32))
        seen = hits.distance < _FAR
        extent = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
        light = _shade(hits, rays, view, seen)
        light[seen] *= _openness(scene, hits, rays, extent, occlusion_rays)
        picture[seen] = palette[kept][hits.triangle[seen]] * light[seen, None]
        if edges:
            picture *= 1 - 0.45 * _edge_lines(hits, extent)[..., None]
    return _averaged(picture, samples)


def render_cloud(
    points: Floats,
    colours: Image | None,
    view: View,
    size: tuple[int, int] = (800, 600),
    *,
    radius: int = 1,
    shade: bool = True,
) -> Image:
    """Picture (height, width, 3) of points (n, 3) as discs of `radius` pixels, nearest in front.

    size: (width, height). colours: (n, 3) uint8 or None for grey. shade: darken pixels that lie
    behind their neighbours, so that shapes can be read. The same arguments give the same bytes.
    """
    width, height = size
    if colours is None:
        colours = np.full((len(points), 3), _PLAIN, dtype=np.uint8)
    depth = np.full((height, width), np.inf)
    picture = np.full((height, width, 3), _BACKGROUND, dtype=np.uint8)
    projected = view.project(np.asarray(points, dtype=np.float64), width, height)
    projected[~(projected[:, 2] > 0)] = np.nan
    _compiled_splat()(projected, np.ascontiguousarray(colours), int(radius), depth, picture)
    if shade:
        picture = (picture * _relief(depth)[..., None] + 0.5).astype(np.uint8)
    return picture


@dataclass(frozen=True)
class _Hits:
    """First hits of a picture's rays: distance (inf: none), triangle, unit normal to the eye."""

    distance: NDArray[np.float32]
    triangle: NDArray[np.int64]
    normal: Floats


def _vector(values: Floats) -> Vector:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _varied(palette: Floats) -> Floats:
    """Give neighbours in a list of colours slightly different shades, to tell objects apart."""
    steps = (np.arange(len(palette))[:, None] * np.array([0.618, 0.755, 0.570])) % 1.0
    shade = 0.84 + 0.2 * steps[:, :1] + 0.06 * steps
    return np.asarray(np.clip(palette * shade, 0, 255))


def _facing(corners: Floats, view: View) -> NDArray[np.bool_]:
    """Triangles (corners relative to the eye) whose front is turned to the camera, (t,)."""
    a, b, c = corners.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    sight = a if view.height is None else view.axes()[2]
    return np.asarray(np.sum(normal * sight, axis=1) < 0)


def _scene(corners: Floats) -> Any:
    """Embree scene of triangles (t, 3, 3)."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    vertices = np.ascontiguousarray(corners.reshape(-1, 3), dtype=np.float32)
    triangles = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(o3d.core.Tensor.from_numpy(vertices), o3d.core.Tensor.from_numpy(triangles))
    return scene


def _cast(scene: Any, rays: NDArray[np.float32]) -> _Hits:
    import open3d as o3d

    answer = scene.cast_rays(o3d.core.Tensor.from_numpy(np.ascontiguousarray(rays)))
    normal = answer["primitive_normals"].numpy().astype(np.float64)
    away = np.sum(normal * rays[..., 3:], axis=-1) > 0
    normal[away] *= -1
    triangle = answer["primitive_ids"].numpy().astype(np.int64)
    return _Hits(answer["t_hit"].numpy(), triangle, normal)


def _shade(hits: _Hits, rays: Floats, view: View, seen: NDArray[np.bool_]) -> Floats:
    """Light of every pixel, (height, width): a lamp above the left shoulder and one at the eye."""
    right, up, forward = view.axes()
    lamp = _unit(up * 0.9 - right * 0.6 - forward * 0.7)
    key = np.clip(hits.normal @ lamp * 0.5 + 0.5, 0, 1) ** 1.3
    head = np.abs(np.sum(hits.normal * rays[..., 3:], axis=-1))
    return np.asarray(np.where(seen, 0.34 + 0.6 * key + 0.2 * head, 1.0))


def _openness(scene: Any, hits: _Hits, rays: Floats, extent: float, count: int) -> Floats:
    """Share of a cosine-weighted hemisphere that is open nearby, for the seen pixels, (s,)."""
    import open3d as o3d

    seen = hits.distance < _FAR
    normal = hits.normal[seen]
    points = rays[seen, :3] + rays[seen, 3:] * hits.distance[seen, None] + normal * (1e-4 * extent)
    random = generator(0, "render", "occlusion")
    blocked = np.zeros(len(points))
    for _ in range(count):
        ball = _unit(random.normal(size=(len(points), 3)))
        probe = np.concatenate([points, _unit(normal * 1.001 + ball)], axis=1).astype(np.float32)
        shadow = scene.test_occlusions(
            o3d.core.Tensor.from_numpy(probe), tnear=0.0, tfar=0.08 * extent
        )
        blocked += shadow.numpy()
    return np.asarray(1 - 0.5 * blocked / max(count, 1))


def _edge_lines(hits: _Hits, extent: float) -> Floats:
    """1 where depth jumps or the surface bends sharply between neighbouring pixels, else 0."""
    distance = np.where(hits.distance < _FAR, hits.distance, 1e3 * extent)
    lines = np.zeros(distance.shape)
    for axis in (0, 1):
        near = np.minimum(*_pairs(distance, axis))
        jump = np.abs(np.diff(distance, axis=axis)) > 0.02 * near + 0.002 * extent
        cosine = np.sum(np.multiply(*_pairs(hits.normal, axis)), axis=-1)
        both = np.logical_and(*_pairs(hits.distance < _FAR, axis))
        first, second = _pairs(lines, axis)
        first[...] = np.maximum(first, jump | (both & (cosine < 0.8)))
        second[...] = np.maximum(second, jump)
    return lines


def _pairs(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Views of all values and of their next neighbours along an axis."""
    count = values.shape[axis]
    index: list[slice] = [slice(None)] * axis
    return values[(*index, slice(0, count - 1))], values[(*index, slice(1, count))]


def _averaged(picture: Floats, samples: int) -> Image:
    height, width = picture.shape[0] // samples, picture.shape[1] // samples
    blocks = picture.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))
    return np.asarray(np.clip(blocks + 0.5, 0, 255).astype(np.uint8))


def _relief(depth: Floats) -> Floats:
    """Brightness 0.35..1 by how far a pixel lies behind its neighbours (eye-dome lighting)."""
    finite = np.isfinite(depth)
    if not finite.any():
        return np.ones(depth.shape)
    level = np.where(finite, np.log2(np.where(finite, depth, 1.0)), np.inf)
    padded = np.pad(level, 2, mode="edge")
    height, width = depth.shape
    behind = np.zeros(depth.shape)
    for row, column in ((0, 2), (4, 2), (2, 0), (2, 4), (1, 1), (1, 3), (3, 1), (3, 3)):
        neighbour = padded[row : row + height, column : column + width]
        with np.errstate(invalid="ignore"):
            behind += np.nan_to_num(np.clip(level - neighbour, 0, 0.1), nan=0.0)
    return np.where(finite, np.maximum(np.exp(-12.0 * behind), 0.35), 1.0)


@cache
def _compiled_splat() -> Any:
    from puckbench.core.compiling import compiled

    return compiled(_splat)


def _splat(
    projected: Floats, colours: Image, radius: int, depth: Floats, picture: Image
) -> None:  # pragma: no cover - compiled
    """Draw discs at (column, row, depth) into `picture`, the nearest in front; nan is skipped."""
    height, width = depth.shape
    for index in range(len(projected)):
        column, row, distance = projected[index]
        if not (-radius <= column < width + radius and -radius <= row < height + radius):
            continue
        middle_x, middle_y = int(np.floor(column)), int(np.floor(row))
        for y in range(max(0, middle_y - radius), min(height, middle_y + radius + 1)):
            for x in range(max(0, middle_x - radius), min(width, middle_x + radius + 1)):
                inside = (x - middle_x) ** 2 + (y - middle_y) ** 2 <= radius * radius
                if inside and distance < depth[y, x]:
                    depth[y, x] = distance
                    picture[y, x] = colours[index]


def tile(images: Sequence[Image], columns: int, gap: int = 4) -> Image:
    """Contact sheet of equally sized images (h, w, 3), row by row, on white."""
    height, width, _ = images[0].shape
    rows = -(-len(images) // columns)
    shape = (rows * (height + gap) - gap, columns * (width + gap) - gap, 3)
    sheet = np.full(shape, 255, dtype=np.uint8)
    for index, image in enumerate(images):
        top, left = (index // columns) * (height + gap), (index % columns) * (width + gap)
        sheet[top : top + height, left : left + width] = image
    return sheet
