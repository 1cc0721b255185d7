from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

Image = NDArray[np.uint8]

_GREY = (200, 196, 188)
_BACKGROUND = 255.0


@dataclass(frozen=True)
class View:
    """An orthographic camera, from which `render_cloud` draws points.

    Parameters
    ----------
    eye, target
        Position of the camera, and a point in the middle of the image, (3,).
    height
        Height of the image, in the unit of the points.
    up
        Direction that points up in the image.
    """

    eye: Floats
    target: Floats
    height: float
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def axes(self) -> tuple[Floats, Floats, Floats]:
        """Return three unit vectors (3,) of the camera: to the right, up, and forward."""
        forward = _unit(self.target - self.eye)
        right = np.cross(forward, np.asarray(self.up, dtype=np.float64))
        if np.linalg.norm(right) < 1e-9:
            raise InputError("view: the up direction is along the line of sight")
        right = _unit(right)
        return right, np.cross(right, forward), forward

    def project(self, points: Floats, width: int, height: int) -> Floats:
        """Project points to pixels of the image.

        Parameters
        ----------
        points
            Coordinates, (n, 3).
        width, height
            Size of the image in pixels.

        Returns
        -------
        numpy.ndarray
            Column, row and depth of each point, (n, 3). Columns and rows are in pixels from the
            upper left corner; depths are distances in front of the camera, in the unit of the
            points.
        """
        right, up, forward = self.axes()
        local = (points - self.eye) @ np.stack([right, up, forward], axis=1)
        scale = height / self.height
        columns, rows = width / 2 + local[:, 0] * scale, height / 2 - local[:, 1] * scale
        return np.column_stack([columns, rows, local[:, 2]])


def render_cloud(
    points: Floats,
    colours: Image | None,
    view: View,
    size: tuple[int, int] = (800, 600),
    *,
    radius: int = 1,
    shade: bool = True,
) -> Image:
    """Draw points as discs, with nearer points in front of farther ones.

    Parameters
    ----------
    points
        Coordinates, (n, 3).
    colours
        Red, green and blue of each point, (n, 3), 0 to 255; None draws all points grey.
    view
        The camera.
    size
        Width and height of the image in pixels.
    radius
        Radius of the discs in pixels.
    shade
        Whether to apply eye-dome lighting, which darkens pixels that lie behind neighbouring
        pixels.

    Returns
    -------
    numpy.ndarray
        The image, (height, width, 3), of red, green and blue from 0 to 255, on white.
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


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _eye_dome_brightness(depth: Floats) -> Floats:
    """Return the brightness of each pixel: 1, or down to 0.35 for pixels behind neighbours."""
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
