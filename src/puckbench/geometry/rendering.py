from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

Image = NDArray[np.uint8]
Vector = tuple[float, float, float]

_GREY = (200, 196, 188)
_BACKGROUND = 255.0


@dataclass(frozen=True)
class View:
    """A camera at `eye` that looks at `target`, with a vertical field of view.

    The camera is orthographic if `height`, the image's height in scene units, is set.
    """

    eye: Vector
    target: Vector
    up: Vector = (0.0, 0.0, 1.0)
    field_of_view_deg: float = 40.0
    height: float | None = None

    def axes(self) -> tuple[Floats, Floats, Floats]:
        """Return the camera's right, up and forward unit vectors."""
        forward = _unit(np.subtract(self.target, self.eye))
        right = np.cross(forward, np.asarray(self.up, dtype=np.float64))
        if np.linalg.norm(right) < 1e-9:
            raise InputError("view: the up direction is along the line of sight")
        right = _unit(right)
        return right, np.cross(right, forward), forward

    def half_extent(self) -> float:
        """Half the image's height in scene units (in a perspective view, at distance 1)."""
        if self.height is not None:
            return self.height / 2
        return float(np.tan(np.radians(self.field_of_view_deg) / 2))

    def project(self, points: Floats, width: int, height: int) -> Floats:
        """Return the columns, rows and depths (n, 3) of points (n, 3) in the image."""
        right, up, forward = self.axes()
        local = (points - np.asarray(self.eye)) @ np.stack([right, up, forward], axis=1)
        depth = local[:, 2]
        scale = height / (2 * self.half_extent())
        distance = np.where(depth > 0, depth, np.nan) if self.height is None else 1.0
        columns = width / 2 + local[:, 0] * scale / distance
        rows = height / 2 - local[:, 1] * scale / distance
        return np.column_stack([columns, rows, depth])


def three_quarter_view(
    bounds: Floats,
    azimuth_deg: float = -60.0,
    elevation_deg: float = 32.0,
    aspect: float = 4 / 3,
    field_of_view_deg: float = 35.0,
) -> View:
    """Return the closest perspective view from a direction that shows a whole box (2, 3)."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) * np.cos(elevation)
    direction[2] = np.sin(elevation)
    centre = np.mean(bounds, axis=0)
    corners = np.stack(np.meshgrid(*np.transpose(bounds), indexing="ij"), axis=-1).reshape(-1, 3)
    right, up, forward = View(_vector(centre + direction), _vector(centre)).axes()
    x, y, depth = ((corners - centre) @ axis for axis in (right, up, forward))
    tangent = np.tan(np.radians(field_of_view_deg) / 2)
    distances = np.maximum(np.abs(x) / aspect, np.abs(y)) / tangent - depth
    eye = centre + direction * (1.04 * distances.max())
    return View(_vector(eye), _vector(centre), field_of_view_deg=field_of_view_deg)


def render_cloud(
    points: Floats,
    colours: Image | None,
    view: View,
    size: tuple[int, int] = (800, 600),
    *,
    radius: int = 1,
    shade: bool = True,
) -> Image:
    """Draw points (n, 3) as discs with a depth buffer; return an image (height, width, 3).

    Colours are RGB (n, 3), by default grey. Sizes are in pixels. `shade` applies eye-dome lighting,
    which darkens pixels behind nearer ones.
    """
    width, height = size
    if colours is None:
        colours = np.full((len(points), 3), _GREY, dtype=np.uint8)
    depth = np.full((height, width), np.inf)
    image = np.full((height, width, 3), _BACKGROUND, dtype=np.uint8)
    projected = view.project(np.asarray(points, dtype=np.float64), width, height)
    projected[~(projected[:, 2] > 0)] = np.nan
    _splat(projected, np.ascontiguousarray(colours), int(radius), depth, image)
    if shade:
        image = (image * _eye_dome_brightness(depth)[..., None] + 0.5).astype(np.uint8)
    return image


def _vector(values: Floats) -> Vector:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _eye_dome_brightness(depth: Floats) -> Floats:
    """Return each pixel's brightness: 1, or down to 0.35 for pixels far behind their neighbours."""
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


@compiled
def _splat(projected: Floats, colours: Image, radius: int, depth: Floats, image: Image) -> None:
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
                    image[y, x] = colours[index]
