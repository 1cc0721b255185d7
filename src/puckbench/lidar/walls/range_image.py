"""The image of a sensor that stands still: cells of one laser and one degree of azimuth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats
from puckbench.lidar.recordings import CaptureTable

Mask = NDArray[np.bool_]
"""Rows of a capture (n,), or cells of an image (lasers by elevation, columns of azimuth)."""

COLUMNS = 360


@dataclass(frozen=True)
class CellImage:
    """The cell of each return (n,), and the image's shape."""

    cell: NDArray[np.intp]
    shape: tuple[int, int]

    @classmethod
    def of(cls, table: CaptureTable) -> CellImage:
        """The image of a capture's returns."""
        levels, rank = np.unique(table["elevation"], return_inverse=True)
        column = (table["azimuth"] * (COLUMNS / math.tau)).astype(np.intp) % COLUMNS
        return cls(rank * COLUMNS + column, (len(levels), COLUMNS))

    @property
    def laser_rank(self) -> NDArray[np.intp]:
        """The row of the image that each return is in, (n,)."""
        return self.cell // self.shape[1]

    def counts(self, rows: Mask) -> Floats:
        """Number of the given returns in each cell."""
        size = self.shape[0] * self.shape[1]
        counts: Floats = np.bincount(self.cell[rows], minlength=size).astype(np.float64)
        return counts.reshape(self.shape)

    def rows(self, cells: Mask) -> Mask:
        """The returns of the given cells."""
        chosen: Mask = cells.ravel()[self.cell]
        return chosen


def largest_patch(cells: Mask, returns: Floats) -> Mask:
    """The connected patch of cells with the most returns; a gap of up to two cells is bridged."""
    from scipy import ndimage

    # The seam of the image is put where the fewest cells are, so that it cuts no patch.
    seam = int(np.argmin(cells.sum(axis=0)))
    labels, count = ndimage.label(widened(np.roll(cells, -seam, axis=1)))
    labels = np.roll(labels, seam, axis=1) * cells
    sizes = np.bincount(labels.ravel(), returns.ravel(), minlength=count + 1)
    largest: Mask = cells & (labels == 1 + int(np.argmax(sizes[1:]))) if count else cells
    return largest


def widened(cells: Mask) -> Mask:
    """The cells and the eight neighbours of each."""
    beside = cells | np.roll(cells, 1, axis=1) | np.roll(cells, -1, axis=1)
    padded = np.pad(beside, ((1, 1), (0, 0)))
    wide: Mask = padded[:-2] | padded[1:-1] | padded[2:]
    return wide


def without_ends(cells: Mask) -> Mask:
    """The cells between two others of the same laser: where a surface ends, returns are mixed."""
    inner: Mask = cells & np.roll(cells, 1, axis=1) & np.roll(cells, -1, axis=1)
    return inner
