"""Prediction of radii and elevations along the lines of a turn, as encoder and decoder do it.

All lines advance together, point by point. A radius is predicted by that of the point before or,
in the first eight lines and with a preceding turn, by a network; an elevation always by a network.
The difference is rounded to a symbol, and the next points are predicted from the decoded ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pcc_networks.inter_lpcm.networks import REFERENCE_LINES, REFERENCE_POINTS
from pcc_networks.inter_lpcm.stream import Heads
from pcc_networks.inter_lpcm.symbols import MAX_SYMBOL
from pcc_networks.inter_lpcm.turn import Ints, Lines, lines_of, spherical
from pcc_networks.inter_lpcm.weights import HISTORY, LpcmWeights
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

RADIUS, ELEVATION = 0, 1
"""Kinds of symbols that are coded during the prediction."""
SYMBOLS_PER_UNIT = (66, 15)
"""Factors of the quantisation of radii (in 1/m) and of elevations (in 1/degree). A symbol is the
difference between a value and its prediction, multiplied by the factor and rounded."""
NETWORK_LINES = 8
"""Lines, from the first on, whose radii a network predicts if there is a preceding turn."""
_STEPS_BEFORE = 2
"""Azimuth steps between the points that stand for those before the first of a line."""
_ROWS = 256
"""Lines for which a network predicts at once."""
Code = Callable[[int, Ints, Ints, Floats], Ints]
"""Function that codes symbols, given their kind, the indices (m,) of the points and of their lines,
and the predicted values (m,). It returns the symbols (m,)."""


class Reference(NamedTuple):
    """A preceding turn, moved to where it would be seen from the present place.

    Parameters
    ----------
    lines
        Azimuth in steps, elevation, radius and number of the line of the points (m, 4) of each line
        that is not empty.
    """

    lines: tuple[Floats, ...]


def reference_of(points: Floats, pose: Floats) -> Reference:
    """Return a preceding turn as a reference for the prediction.

    Parameters
    ----------
    points
        Decoded points (n, 3), n >= 1, of the preceding turn, in its own coordinates.
    pose
        Matrix (4, 4) that moves them to the coordinates of the present turn.
    """
    starts = lines_of(points).starts
    moved = np.asarray(points, np.float64) @ pose[:3, :3].T + pose[:3, 3]
    azimuth, elevation, radius = spherical(moved)
    numbers = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    rows = np.column_stack([azimuth, elevation, radius, numbers])
    return Reference(tuple(np.split(rows, starts[1:-1])))


def points_at_steps(starts: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Yield, for each step, the indices of the points that are coded and those of their lines.

    Step k takes point k of each line that has one, the longest lines first.
    """
    lengths = np.diff(starts)
    order = np.argsort(-lengths, kind="stable")
    active = np.searchsorted(-lengths[order], -np.arange(lengths.max()), side="left")
    for step, count in enumerate(active):
        rows = order[:count]
        yield starts[rows] + step, rows


def traverse(
    heads: Heads, azimuth: Ints, weights: LpcmWeights, reference: Reference | None, code: Code
) -> Lines:
    """Predict and code the radii and elevations of a turn, and return the decoded lines.

    Parameters
    ----------
    heads
        First points of the lines.
    azimuth
        Azimuths (n,) of all points, in steps, line after line.
    weights
        The networks.
    reference
        The preceding turn, or None.
    code
        Function that encodes or decodes symbols.
    """
    starts = heads.starts
    decoded = np.zeros((2, len(azimuth)))
    history = _first_history(heads)
    for at, rows in points_at_steps(starts):
        before = history[rows]
        radius = before[:, -1, 2].copy()
        if reference is not None:
            top = np.flatnonzero(rows < NETWORK_LINES)
            if len(top):
                near = _near(reference, rows[top], azimuth[at[top]])
                radius[top] = _radii(weights, before[top], near)
        radius += code(RADIUS, at, rows, radius) / SYMBOLS_PER_UNIT[RADIUS]
        elevation = before[:, -1, 1] + _changes(weights, before, azimuth[at])
        elevation += code(ELEVATION, at, rows, elevation) / SYMBOLS_PER_UNIT[ELEVATION]
        decoded[0, at], decoded[1, at] = radius, elevation
        history[rows, :-1] = before[:, 1:]
        history[rows, -1, :3] = np.column_stack([azimuth[at], elevation, radius])
    return Lines(azimuth, decoded[1], decoded[0], starts)


def rounded(kind: int, values: Floats, predicted: Floats) -> Ints:
    """Return the symbols (m,) of values, given their predictions.

    Raises InputError if a symbol is too large.
    """
    symbols = np.rint((values - predicted) * SYMBOLS_PER_UNIT[kind])
    if np.abs(symbols).max(initial=0) > MAX_SYMBOL:
        raise InputError("points of a line are too far from each other for inter_lpcm")
    return symbols.astype(np.int64)


def _first_history(heads: Heads) -> NDArray[np.float64]:
    count = len(heads.lengths)
    history = np.zeros((count, HISTORY, 4))
    back = _STEPS_BEFORE * np.arange(HISTORY, 0, -1)
    history[:, :, 0] = heads.azimuth[:, None] - back
    history[:, :, 1] = heads.elevation[:, None]
    history[:, :, 2] = heads.radius[:, None]
    history[:, :, 3] = np.arange(count)[:, None]
    return history


def _changes(weights: LpcmWeights, before: Floats, azimuth: Ints) -> Floats:
    changes = [
        weights.elevation(_tensor(before[k : k + _ROWS]), _tensor(azimuth[k : k + _ROWS]))
        for k in range(0, len(before), _ROWS)
    ]
    return torch.cat(changes).double().numpy()


def _radii(weights: LpcmWeights, before: Floats, near: Floats) -> Floats:
    changes = before[:, :-1].copy()
    changes[:, :, 2] = np.diff(before[:, :, 2], axis=1)  # in double precision, as by the authors
    history = before.copy()
    history[:, :, 3] = 0  # the authors' program leaves out the number of the line here alone
    inputs = (_tensor(values) for values in (history, changes, near))
    radii: Floats = weights.radius(*inputs).double().numpy()
    return radii


def _tensor(values: Floats | Ints) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))


def _near(reference: Reference, rows: Ints, azimuth: Ints) -> Floats:
    """Return the points (m, 3, 20, 4) of the reference around azimuths (m,) of lines (m,)."""
    near = np.empty((len(rows), REFERENCE_LINES, REFERENCE_POINTS, 4))
    for k, (row, step) in enumerate(zip(rows, azimuth, strict=True)):
        for j in range(REFERENCE_LINES):
            number = min(max(int(row) + j - REFERENCE_LINES // 2, 0), len(reference.lines) - 1)
            near[k, j] = _window(reference.lines[number], int(step))
    return near


def _window(line: Floats, azimuth: int) -> Floats:
    """Return the 20 points of a line around an azimuth; a short line repeats the nearest point."""
    nearest = int(np.abs(line[:, 0] - azimuth).argmin())
    missing = REFERENCE_POINTS - len(line)
    if missing <= 0:
        first = min(max(nearest - REFERENCE_POINTS // 2, 0), -missing)
        return line[first : first + REFERENCE_POINTS]
    places = np.arange(REFERENCE_POINTS)
    repeated = np.where(places < nearest, places, np.maximum(nearest, places - missing))
    return line[repeated]
