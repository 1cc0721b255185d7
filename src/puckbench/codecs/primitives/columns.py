"""Which columns of a leaf's plane to keep: the fewest bits for the least error, by the samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.codecs.primitives.layout import Bytes, Ints, Owners
from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats


class Choice(NamedTuple):
    """Samples to hold points against, and the prices of errors and bits.

    xyz, normals: (n, 3) samples. weights: (n,) shares of the cloud's points. rows: grid of the
    samples by their cell, row + 1, 0 for none. cell: side of a sample's cell. across: share of the
    squared distance to the nearest sample that counts as an error, past a cell. most: largest
    squared error. missing: squared error of samples left out. area: weight of a sample's cell of
    points. edge: price of two unlike columns side by side.
    """

    xyz: Floats
    normals: Floats
    weights: Floats
    rows: Owners
    cell: float
    across: float
    most: float
    missing: float
    area: float
    edge: float


NO_CHOICE = Choice(
    np.zeros((1, 3)),
    np.zeros((1, 3)),
    np.zeros(1),
    np.zeros((1, 1, 1), np.int32),
    *(1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
)
"""For the decoder, which has none to make."""


@compiled_in_place
def gain_at(choice: Choice, point: Floats) -> float:
    """What a sample's cell of points like this one saves: samples' error without, less its own."""
    row, squared = _nearest(choice, point)
    if row < 0:
        return -choice.area * choice.most
    along = 0.0
    for k in range(3):
        along += (point[k] - choice.xyz[row, k]) * choice.normals[row, k]
    beyond = max(np.sqrt(squared) - choice.cell, 0.0)
    error = min(along * along + choice.across * beyond * beyond, choice.most)
    saved = choice.missing * choice.weights[row] if beyond == 0.0 else 0.0
    return float(saved - choice.area * error)


@compiled_in_place
def _nearest(choice: Choice, point: Floats) -> tuple[int, float]:
    """Row of the nearest sample within two cells, -1 for none, and its squared distance."""
    sure = np.inf  # no sample outside the cells around the point's own is nearer
    for k in range(3):
        past = point[k] - (int(point[k] / choice.cell) - 1) * choice.cell
        sure = min(sure, past, 3 * choice.cell - past)
    row, squared = _nearest_within(choice, point, 1)
    return (row, squared) if squared <= sure * sure else _nearest_within(choice, point, 2)


@compiled_in_place
def _nearest_within(choice: Choice, point: Floats, reach: int) -> tuple[int, float]:
    x, y, z = point
    cell, rows = choice.cell, choice.rows
    at, across, up = int(x / cell), int(y / cell), int(z / cell)
    nearest, found = np.inf, -1
    for i in range(max(at - reach, 0), min(at + reach + 1, rows.shape[0])):
        for j in range(max(across - reach, 0), min(across + reach + 1, rows.shape[1])):
            for k in range(max(up - reach, 0), min(up + reach + 1, rows.shape[2])):
                row = rows[i, j, k] - 1
                if row >= 0:
                    p = choice.xyz[row]
                    squared = (p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2
                    if squared < nearest:
                        nearest, found = squared, row
    return found, nearest


@compiled
def choose(gains: Floats, edge: float, known: Ints, bits: Bytes) -> None:
    """Choose the bits of a bitmap that gain most, less `edge` for each unlike pair of neighbours.

    gains, bits: (n, n). known: (n + 2, n + 2) states around: 1 empty, 2 surface, 0 not known.
    Iterated conditional modes (Besag 1986, "On the statistical analysis of dirty pictures").
    """
    side = len(gains)
    for a in range(side):
        for b in range(side):
            bits[a, b] = 1 if gains[a, b] > 0 else 0
    for _ in range(4):
        changed = False
        for a in range(side):
            for b in range(side):
                bit = 1 if gains[a, b] + edge * _pull(bits, known, a, b) > 0 else 0
                changed |= bit != bits[a, b]
                bits[a, b] = bit
        if not changed:
            break


@compiled_in_place
def _pull(bits: Bytes, known: Ints, a: int, b: int) -> int:
    """Neighbours of a bit that are 1 less those that are 0."""
    side, pull = len(bits), 0
    for k in range(4):
        x = a + (k == 0) - (k == 1)
        y = b + (k == 2) - (k == 3)
        if 0 <= x < side and 0 <= y < side:
            pull += 2 * int(bits[x, y]) - 1
        else:
            pull += (known[x + 1, y + 1] == 2) - (known[x + 1, y + 1] == 1)
    return pull
