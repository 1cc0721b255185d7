"""Which columns of round surfaces to keep, and which samples are left to planes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives.detect import bounded, explained
from puckbench.codecs.primitives.layout import Bytes, Ints
from puckbench.codecs.primitives.revolved import (
    MOST_COLUMNS,
    Round,
    fits,
    packed,
    points_on,
    unpacked,
)
from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats

Mask = NDArray[np.bool_]


class Wrapped(NamedTuple):
    """A surface of revolution as a stream has it, and its columns that are surface."""

    surface: Round
    bits: Bytes


class Prices(NamedTuple):
    """Squared errors in cells: of what is left out, share of that across, the largest; tolerance.

    cell: side of a sample's cell. edge: price of two unlike columns side by side, in errors of a
    column.
    """

    missing: float
    across: float
    most: float
    tolerance: float
    cell: float
    edge: float


def placed(
    surface: Round, turned: Floats, low: Floats, cell: float, margins: tuple[float, float, float]
) -> Round:
    """A surface in units along the cells' axes (rotation (3, 3), least corner), in cells."""
    origin = (turned @ surface.origin - low) / cell + margins
    return surface._replace(origin=origin, axis=turned @ surface.axis, radius=surface.radius / cell)


def wrapped(
    surfaces: list[Round], xyz: Floats, normals: Floats, gain: Floats, prices: Prices
) -> tuple[list[Wrapped], Mask]:
    """Bitmaps of surfaces (in cells) over samples (n, 3), and which samples none of them has.

    gain: (n,) what a sample's points weigh for each weight of its area.
    """
    left = np.ones(len(xyz), bool)
    found: list[Wrapped] = []
    for wanted in surfaces:
        bound = bounded(wanted, xyz, normals, left, prices.tolerance)
        if bound.rows == 0 or not fits(bound):
            continue
        (surface,) = unpacked(packed(bound))
        rows = np.flatnonzero(left & explained(surface, xyz, normals, prices.tolerance))
        if not len(rows):
            continue
        columns = sum(len(wrap.bits) for wrap in found) + int(surface.columns().sum())
        if columns > MOST_COLUMNS:
            continue
        bits = _bitmap(surface, xyz[rows], normals[rows], gain[rows], prices)
        held = rows[_on(surface, bits, xyz[rows])]
        if len(held):
            found.append(Wrapped(surface, bits))
            left[held] = False
    return found, left


def _bitmap(surface: Round, xyz: Floats, normals: Floats, gain: Floats, prices: Prices) -> Bytes:
    """The columns whose middle is nearer to a sample than it costs to leave that out."""
    from scipy.spatial import cKDTree

    middles, _ = points_on(surface, np.ones(int(surface.columns().sum()), np.uint8), 1, 1)
    away, near = cKDTree(xyz).query(middles)
    along = np.einsum("ij,ij->i", middles - xyz[near], normals[near])
    beyond = np.maximum(away - prices.cell, 0)
    error = np.minimum(along**2 + prices.across * beyond**2, prices.most)
    saved = np.where(beyond == 0, prices.missing * gain[near], 0.0)
    bits: Bytes = (saved > error).astype(np.uint8)
    _settle(saved - error, surface.columns(), prices.edge, bits)
    return bits


@compiled
def _settle(gains: Floats, columns: Ints, edge: float, bits: Bytes) -> None:
    """Change bits until none gains by it, `edge` for each unlike neighbour (Besag 1986)."""
    starts = np.zeros(len(columns) + 1, np.int64)
    for row in range(len(columns)):
        starts[row + 1] = starts[row] + columns[row]
    for _ in range(4):
        for row in range(len(columns)):
            start, count = starts[row], columns[row]
            for j in range(count):
                pull = 2 * (bits[start + (j + 1) % count] + bits[start + (j + count - 1) % count])
                pull -= 2
                for beside in (row - 1, row + 1):
                    if 0 <= beside < len(columns) and columns[beside] > 0:
                        at = starts[beside] + (j * columns[beside]) // count
                        pull += 2 * bits[at] - 1
                bits[start + j] = 1 if gains[start + j] + edge * pull > 0 else 0


def _on(surface: Round, bits: Bytes, xyz: Floats) -> Mask:
    """Which points lie on columns that are set."""
    along, turn, _, _ = surface.coordinates(xyz)
    columns = surface.columns()
    row = np.floor(along).astype(np.int64) - surface.first
    inside = (row >= 0) & (row < surface.rows)
    row = row.clip(0, max(surface.rows - 1, 0))
    place = np.floor(turn % (2 * np.pi) / (2 * np.pi) * columns[row]).astype(np.int64)
    place = np.minimum(place, columns[row] - 1)
    starts = np.cumsum(columns) - columns
    on = np.zeros(len(xyz), bool)
    valid = inside & (place >= 0)
    on[valid] = bits[starts[row[valid]] + place[valid]] == 1
    return on
