"""Scans as grids of columns seen from above, and as features of single points.

A cell of the grid knows which heights are occupied in its column, and its lowest and highest point.
Points that fall on each other, and their order, change nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat

from pointkit.models import Model

Singles = NDArray[np.float32]
HEIGHTS = 3
"""Number of channels of a cell besides those of its occupied bins of height: the heights of its
lowest point, of its highest point, and of the lowest point in the window around it."""
OFFSETS = 8
"""Number of features of a point besides those of the bins of height."""
_SCALE_M = 4.0
"""Length by which heights are divided, so that they are of the order of one."""
_MOST = 4.0
"""Largest magnitude of a feature of a point."""
_FARTHEST_M = 1e6


class GridShape(Model):
    """Sizes of the grid.

    Parameters
    ----------
    cell_m
        Side of a cell, m.
    cells
        Cells along each side of the square around the sensor, a multiple of 8.
    bottom_m
        Height of the lowest bin's lower end above the sensor, m.
    bin_m, bins
        Height of a bin, m, and number of bins.
    near_cells
        Side of the window, in cells, whose lowest point stands for the ground; odd.
    """

    cell_m: Annotated[PositiveFloat, Field(ge=0.01, le=10.0)] = 0.4
    cells: Annotated[int, Field(ge=8, le=1024, multiple_of=8)] = 256
    bottom_m: Annotated[float, Field(ge=-100.0, le=100.0)] = -3.0
    bin_m: Annotated[PositiveFloat, Field(ge=0.01, le=10.0)] = 0.3
    bins: Annotated[int, Field(ge=1, le=64)] = 24
    near_cells: Annotated[int, Field(ge=1, le=99)] = 9

    @property
    def half_m(self) -> float:
        """Half of the side of the square, m."""
        return self.cell_m * self.cells / 2


@dataclass(frozen=True)
class Gridded:
    """A scan as the network sees it.

    Parameters
    ----------
    columns
        Channels of the cells (bins + `HEIGHTS`, cells, cells): channel, y, x.
    places
        Place of each point in the square (n, 2): x and y from -1 to 1, beyond for points outside.
    features
        Features of each point (n, bins + `OFFSETS`).
    """

    columns: Singles
    places: Singles
    features: Singles


def gridded(
    xyz: NDArray[Any],
    shape: GridShape,
    middle: Sequence[float] | NDArray[Any] = (0.0, 0.0),
    rows: NDArray[np.intp] | None = None,
) -> Gridded:
    """Return a scan as the network sees it.

    Parameters
    ----------
    xyz
        Points (n, 3) in the sensor's frame, m.
    shape
        Sizes of the grid.
    middle
        Middle of the grid (x, y) in the sensor's frame, m.
    rows
        Rows (m,) of the points whose places and features are returned; by default all.
    """
    points = np.clip(np.asarray(xyz, dtype=np.float64), -_FARTHEST_M, _FARTHEST_M)
    scaled = (points[:, :2] - middle + shape.half_m) / shape.cell_m
    inside = np.all((scaled >= 0) & (scaled < shape.cells), axis=1)
    column, row = np.clip(np.floor(scaled), 0, shape.cells - 1).astype(np.int64).T
    cell, z = row * shape.cells + column, points[:, 2]

    occupied = np.zeros((shape.bins, shape.cells**2), np.float32)
    level = np.clip(np.floor((z[inside] - shape.bottom_m) / shape.bin_m), 0, shape.bins - 1)
    occupied[level.astype(np.int64), cell[inside]] = 1
    lowest, highest = np.full(shape.cells**2, np.inf), np.full(shape.cells**2, -np.inf)
    np.minimum.at(lowest, cell[inside], z[inside])
    np.maximum.at(highest, cell[inside], z[inside])
    near = lowest_near(lowest.reshape(shape.cells, shape.cells), shape.near_cells).ravel()
    heights = np.stack([lowest, highest, near])
    channels = np.where(np.isfinite(heights), heights / _SCALE_M, 0).astype(np.float32)
    columns = np.concatenate([occupied, channels]).reshape(-1, shape.cells, shape.cells)

    if rows is not None:
        points, scaled, cell, z = points[rows], scaled[rows], cell[rows], z[rows]
        inside = inside[rows]
    features = np.zeros((len(points), shape.bins + OFFSETS), np.float32)
    features[:, 0] = z / _SCALE_M
    for number, level_m in enumerate((near, lowest, highest), start=1):
        features[inside, number] = (z[inside] - level_m[cell[inside]]) / (_SCALE_M / 2)
    features[:, 4:6] = scaled - np.floor(scaled) - 0.5
    features[:, 6] = np.log1p(np.linalg.norm(points, axis=1)) / _SCALE_M
    features[:, 7] = inside
    np.clip(features, -_MOST, _MOST, out=features)
    features[:, OFFSETS:] = _in_bins(z, shape)
    places = (points[:, :2] - middle) / shape.half_m
    return Gridded(columns, places.astype(np.float32), features)


def lowest_near(lowest: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """Return the minimum of an image (rows, columns) in a square window around each cell."""
    for axis in (0, 1):
        width = [(0, 0), (0, 0)]
        width[axis] = (window // 2, window // 2)
        padded = np.pad(lowest, width, constant_values=np.inf)
        lowest = np.lib.stride_tricks.sliding_window_view(padded, window, axis).min(axis=-1)
    return lowest


def _in_bins(z: NDArray[np.float64], shape: GridShape) -> Singles:
    """Return how near a height is to the middle of each bin, from 0 to 1, (n, bins)."""
    middle = np.clip((z - shape.bottom_m) / shape.bin_m - 0.5, 0, shape.bins - 1)
    near = np.maximum(0, 1 - np.abs(middle[:, None] - np.arange(shape.bins)))
    return np.asarray(near, np.float32)
