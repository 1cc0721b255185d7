"""Frames of LiDAR sensors as float32 values without a header (.bin), as in KITTI and nuScenes.

Such a file does not say how many values each point has. Their number is estimated: it is the lag
(in values) at which the values of the file differ least.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.content import read_content
from pointkit.errors import InputError
from pointkit.files import write_bytes
from pointkit.isolated import Columns

Rows = NDArray[np.float32]

_LAYOUTS = {
    3: ("x", "y", "z"),
    4: ("x", "y", "z", "intensity"),
    5: ("x", "y", "z", "intensity", "ring"),
    6: ("x", "y", "z", "intensity", "ring", "time"),
}
_DEFAULT_COUNT = 4
_LAGS = range(3, 9)
_MAX_VALUES, _MIN_VALUES = 60_000, 40
_MIN_MARGIN = 0.02
"""Minimum gap between the smallest mean rank difference and the next; unrelated values differ by
1/3."""
_MAX_RINGS = 128
_MAX_COORDINATE_M, _MIN_COORDINATE_M = 1e5, 1e-20
"""Bounds of the absolute values of nonzero coordinates."""


def read_float32_frame(path: Path, columns: str | None = None) -> Columns:
    """Read one frame of a LiDAR from a headerless file of float32 values, as in KITTI or nuScenes.

    Parameters
    ----------
    path
        The file, which may be compressed.
    columns
        The columns of the file: their number, or their names separated by commas, such as
        ``x,y,z,intensity,time``. A number is from 3 to 6 and means as many of x, y, z, intensity,
        ring and time, in this order. A column named ``_`` is left out. By default, the number of
        columns is estimated, and the fifth and sixth column are recognised by the range of their
        values.

    Returns
    -------
    dict
        Columns (n,) of float32 by name; coordinates are in metres.

    Raises
    ------
    InputError
        The file is empty or truncated, it is unclear how many values a point has, or coordinates
        are beyond 100 km or below 1e-20 m.
    """
    data = read_content(path)
    if not data:
        raise InputError(f"{path}: the cloud is empty")
    names = _detected_layout(data, path) if columns is None else _named_layout(columns)
    rows = float32_rows(data, len(names), path)
    places = [names.index(axis) for axis in "xyz"]
    if not _are_coordinates(rows[:, places]):
        fault = f"coordinates beyond {_MAX_COORDINATE_M:g} m or below {_MIN_COORDINATE_M:g} m"
        raise InputError(f"{path}: no frame of a LiDAR in rows of {len(names)}: {fault}")
    return {name: rows[:, place] for place, name in enumerate(names) if name != "_"}


def write_float32_frame(path: str | Path, columns: Columns) -> None:
    """Write a frame as KITTI does: x, y, z and intensity of each point as float32, no header.

    Parameters
    ----------
    path
        The file to write.
    columns
        Arrays (n,) by name. Columns other than these four are not written.
    """
    rows = np.column_stack([columns[name] for name in _LAYOUTS[_DEFAULT_COUNT]])
    write_bytes(path, rows.astype("<f4").tobytes())


def float32_rows(data: bytes, count: int, path: Path) -> Rows:
    """Return the content of a file as an array (n, count) with one row for each point.

    Parameters
    ----------
    data
        Content of the file.
    count
        Number of values of each point.
    path
        The file that messages name.

    Raises
    ------
    InputError
        The last row is incomplete.
    """
    size = 4 * count
    if len(data) % size:
        raise InputError(f"{path}: truncated: {len(data)} bytes are not whole points of {size}")
    return np.frombuffer(data, dtype="<f4").reshape(-1, count)


def detect_column_count(values: NDArray[Any]) -> int | None:
    """Estimate how many columns a table has, if only its values are known.

    The values are replaced by their ranks. The estimate is the lag between two values at which the
    mean difference of ranks is smallest.

    Parameters
    ----------
    values
        Values of the table, row by row, (n,).

    Returns
    -------
    int or None
        Number of columns; None if no number is clearly better than the others.
    """
    sample = values[:_MAX_VALUES]
    if len(sample) < _MIN_VALUES:
        return None
    _, place, counts = np.unique(sample, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - counts / 2)[place] / len(sample)
    differences = {lag: float(np.abs(ranks[lag:] - ranks[:-lag]).mean()) for lag in _LAGS}
    margin = _MIN_MARGIN + 1 / np.sqrt(len(sample))
    least = min(differences.values())
    best = min(lag for lag in differences if differences[lag] <= least + margin / 2)
    others = min(differences[lag] for lag in differences if lag % best)
    return best if others >= differences[best] + margin else None


def check_column_count(path: Path, data: bytes, count: int) -> None:
    """Raise InputError if the values suggest a number of columns other than `count`."""
    detected = detect_column_count(np.frombuffer(data[: len(data) // 4 * 4], dtype="<f4"))
    if detected not in (None, count):
        raise InputError(f"{path}: its points have {detected} values each, not {count}")


def _detected_layout(data: bytes, path: Path) -> tuple[str, ...]:
    values = np.frombuffer(data[: len(data) // 4 * 4], dtype="<f4")
    detected = detect_column_count(values)
    counts = _candidate_counts(values, len(data)) if detected is None else [detected]
    if len(counts) > 1 or counts[0] not in _LAYOUTS:
        candidates = " or ".join(map(str, counts))
        advice = "name them (prepare, run: --bin-columns x,y,z,intensity)"
        raise InputError(f"{path}: its points may have {candidates} values each: {advice}")
    return _column_names(float32_rows(data, counts[0], path))


def _candidate_counts(values: Rows, size: int) -> list[int]:
    rows = {count: values.reshape(-1, count) for count in _LAYOUTS if size % (4 * count) == 0}
    possible = [count for count in rows if _are_coordinates(rows[count])]
    likely = [count for count in possible if _is_likely(rows[count])]
    return likely or possible or [*rows][:1] or [_DEFAULT_COUNT]


def _column_names(rows: Rows) -> tuple[str, ...]:
    names = [*_LAYOUTS[min(rows.shape[1], _DEFAULT_COUNT)]]
    for place in range(len(names), rows.shape[1]):
        likely = "ring" if _are_rings(rows[:, place]) else "time"
        names.append(f"column_{place + 1}" if likely in names else likely)
    return tuple(names)


def _named_layout(columns: str) -> tuple[str, ...]:
    if columns.isdecimal() and int(columns) in _LAYOUTS:
        return _LAYOUTS[int(columns)]
    names = tuple(name.strip().lower() for name in columns.split(","))
    used = [name for name in names if name != "_"]
    if not {"x", "y", "z"} <= set(names) or len(set(used)) < len(used):
        raise InputError(f"bin_columns: 3 to 6, or different names with x, y and z, not {columns}")
    return names


def _is_likely(rows: Rows) -> bool:
    others = rows[:, 3:]
    return bool((others >= 0).all()) and (rows.shape[1] < 5 or _are_rings(rows[:, 4]))


def _are_coordinates(rows: Rows) -> bool:
    sizes = np.abs(rows[:, :3])
    with np.errstate(invalid="ignore"):
        large = np.isfinite(sizes) & (sizes > _MAX_COORDINATE_M)
        small = (sizes > 0) & (sizes < _MIN_COORDINATE_M)
    return not (large | small).any()


def _are_rings(values: Rows) -> bool:
    return bool(((values == np.floor(values)) & (values >= 0) & (values < _MAX_RINGS)).all())
