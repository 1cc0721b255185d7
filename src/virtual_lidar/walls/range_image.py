from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.lidar.return_table import ReturnTable

Mask = NDArray[np.bool_]
"""Mask of a recording (n,), or of a range image (lasers by elevation, columns by azimuth)."""

COLUMNS = 360


@dataclass(frozen=True)
class RangeImage:
    """Range image of a recording, with a pixel for each laser and degree of azimuth.

    `pixel` (n,) are the flat pixel indices of returns.
    """

    pixel: NDArray[np.intp]
    shape: tuple[int, int]

    @classmethod
    def of(cls, table: ReturnTable) -> RangeImage:
        levels, rank = np.unique(table["elevation"], return_inverse=True)
        column = (table["azimuth"] * (COLUMNS / math.tau)).astype(np.intp) % COLUMNS
        return cls(rank * COLUMNS + column, (len(levels), COLUMNS))

    @property
    def laser_rank(self) -> NDArray[np.intp]:
        return self.pixel // self.shape[1]

    def counts(self, rows: Mask) -> Floats:
        size = self.shape[0] * self.shape[1]
        counts: Floats = np.bincount(self.pixel[rows], minlength=size).astype(np.float64)
        return counts.reshape(self.shape)

    def rows(self, pixels: Mask) -> Mask:
        chosen: Mask = pixels.ravel()[self.pixel]
        return chosen


def largest_patch(pixels: Mask, returns: Floats) -> Mask:
    """Return the patch with most returns; gaps of up to two pixels do not split a patch."""
    from scipy import ndimage

    # The seam of the image is moved to the column with the fewest pixels, to not cut a patch.
    seam = int(np.argmin(pixels.sum(axis=0)))
    labels, count = ndimage.label(widened(np.roll(pixels, -seam, axis=1)))
    labels = np.roll(labels, seam, axis=1) * pixels
    sizes = np.bincount(labels.ravel(), returns.ravel(), minlength=count + 1)
    largest: Mask = pixels & (labels == 1 + int(np.argmax(sizes[1:]))) if count else pixels
    return largest


def widened(pixels: Mask) -> Mask:
    """Dilate a mask by the eight neighbours of each pixel."""
    beside = pixels | np.roll(pixels, 1, axis=1) | np.roll(pixels, -1, axis=1)
    padded = np.pad(beside, ((1, 1), (0, 0)))
    wide: Mask = padded[:-2] | padded[1:-1] | padded[2:]
    return wide


def without_ends(pixels: Mask) -> Mask:
    """Erode a mask by one pixel along rows, since returns at the ends mix two surfaces."""
    inner: Mask = pixels & np.roll(pixels, 1, axis=1) & np.roll(pixels, -1, axis=1)
    return inner
