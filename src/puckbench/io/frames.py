"""Frames of LiDARs as bare float32 (.bin): those of KITTI, nuScenes and others alike.

Such a file does not say how many values a point has; its values do. Values of one column are more
alike than values of two, so the number of columns is the distance at which values differ least.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.content import read_content
from puckbench.core.errors import InputError
from puckbench.io.point_columns import Columns

Rows = NDArray[np.float32]

_LAYOUTS = {
    3: ("x", "y", "z"),
    4: ("x", "y", "z", "intensity"),
    5: ("x", "y", "z", "intensity", "ring"),
    6: ("x", "y", "z", "intensity", "ring", "time"),
}
_USUAL = 4
_DISTANCES = range(3, 9)
_LOOKED_AT, _FEWEST_VALUES = 60_000, 40
_LEAST_MARGIN = 0.02
"""Of mean differences of ranks, which are a third for values that have nothing in common."""
_MOST_RINGS = 128
_FARTHEST_M, _NEAREST_M = 1e5, 1e-20
"""No coordinates of such frames, but for 0, are greater or less."""


def read_frame(path: Path, columns: str | None = None) -> Columns:
    """Read a frame of float32: x, y, z, often the intensity, the ring and the time.

    Parameters
    ----------
    path
        The file.
    columns
        How many values a point has (3 to 6), or their names (``x,y,z,intensity,time``); by
        default what the values tell.

    Raises
    ------
    InputError
        The file is missing, cut short, holds no coordinates of such a sensor, or may have several
        layouts.
    """
    data = read_content(path)
    if not data:
        raise InputError(f"{path}: the cloud is empty")
    names = _layout(data, path) if columns is None else _named(columns)
    rows = rows_of(data, len(names), path)
    places = [names.index(axis) for axis in "xyz"]
    if not _are_coordinates(rows[:, places]):
        beyond = f"coordinates beyond {_FARTHEST_M:g} m or below {_NEAREST_M:g} m"
        raise InputError(f"{path}: no frame of a LiDAR in rows of {len(names)}: {beyond}")
    return {name: rows[:, place] for place, name in enumerate(names) if name != "_"}


def rows_of(data: bytes, count: int, path: Path) -> Rows:
    """Values in rows of `count`; InputError where the last row is not whole."""
    size = 4 * count
    if len(data) % size:
        raise InputError(f"{path}: truncated: {len(data)} bytes are not whole points of {size}")
    return np.frombuffer(data, dtype="<f4").reshape(-1, count)


def told_columns(values: NDArray[Any]) -> int | None:
    """The number of columns that values (n,) tell; None where they do not.

    It is the least distance at which the ranks of values differ least, if they differ by clearly
    more at all other distances than its multiples.
    """
    seen = values[:_LOOKED_AT]
    if len(seen) < _FEWEST_VALUES:
        return None
    _, place, counts = np.unique(seen, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - counts / 2)[place] / len(seen)
    apart = {step: float(np.abs(ranks[step:] - ranks[:-step]).mean()) for step in _DISTANCES}
    margin = _LEAST_MARGIN + 1 / np.sqrt(len(seen))
    least = min(apart.values())
    found = min(step for step in apart if apart[step] <= least + margin / 2)
    others = min(apart[step] for step in apart if step % found)
    return found if others >= apart[found] + margin else None


def check_columns(path: Path, data: bytes, count: int) -> None:
    """InputError where the values of a file tell another number of columns."""
    told = told_columns(np.frombuffer(data[: len(data) // 4 * 4], dtype="<f4"))
    if told not in (None, count):
        raise InputError(f"{path}: its points have {told} values each, not {count}")


def _layout(data: bytes, path: Path) -> tuple[str, ...]:
    """Names of the columns of a file's values; InputError where several layouts fit."""
    values = np.frombuffer(data[: len(data) // 4 * 4], dtype="<f4")
    told = told_columns(values)
    counts = _fitting(values, len(data)) if told is None else [told]
    if len(counts) > 1 or counts[0] not in _LAYOUTS:
        several = " or ".join(map(str, counts))
        how = "name them (prepare, run: --bin-columns x,y,z,intensity)"
        raise InputError(f"{path}: its points may have {several} values each: {how}")
    return _names_of(rows_of(data, counts[0], path))


def _fitting(values: Rows, size: int) -> list[int]:
    """Numbers of columns of a file of some size: the likely ones, else possible ones, else any."""
    whole = {count: values.reshape(-1, count) for count in _LAYOUTS if size % (4 * count) == 0}
    possible = [count for count in whole if _are_coordinates(whole[count])]
    likely = [count for count in possible if _is_likely(whole[count])]
    return likely or possible or [*whole][:1] or [_USUAL]


def _names_of(rows: Rows) -> tuple[str, ...]:
    """Names of a frame's columns: x, y, z, intensity, the ring if it has one, and the time."""
    names = [*_LAYOUTS[min(rows.shape[1], _USUAL)]]
    for place in range(len(names), rows.shape[1]):
        likely = "ring" if _are_rings(rows[:, place]) else "time"
        names.append(f"column_{place + 1}" if likely in names else likely)
    return tuple(names)


def _named(columns: str) -> tuple[str, ...]:
    """Names of columns that an option gives, or their number."""
    if columns.isdecimal() and int(columns) in _LAYOUTS:
        return _LAYOUTS[int(columns)]
    names = tuple(name.strip().lower() for name in columns.split(","))
    used = [name for name in names if name != "_"]
    if not {"x", "y", "z"} <= set(names) or len(set(used)) < len(used):
        raise InputError(f"bin_columns: 3 to 6, or different names with x, y and z, not {columns}")
    return names


def _is_likely(rows: Rows) -> bool:
    """Whether the values after coordinates can be an intensity, a ring and a time."""
    more = rows[:, 3:]
    return bool((more >= 0).all()) and (rows.shape[1] < 5 or _are_rings(rows[:, 4]))


def _are_coordinates(rows: Rows) -> bool:
    sizes = np.abs(rows[:, :3])
    with np.errstate(invalid="ignore"):
        far, near = np.isfinite(sizes) & (sizes > _FARTHEST_M), (sizes > 0) & (sizes < _NEAREST_M)
    return not (far | near).any()


def _are_rings(values: Rows) -> bool:
    return bool(((values == np.floor(values)) & (values >= 0) & (values < _MOST_RINGS)).all())
