from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats

_COLUMNS = 6
_ALLOWED = b"0123456789+-.eE \t\r\n"
_IS_FOREIGN = np.ones(256, dtype=np.bool_)
_IS_FOREIGN[list(_ALLOWED)] = False
_FOREIGN = re.compile(rb"([^0-9.eE+\- \t\r\n]+)")
_MOST_RUNS = 8


@dataclass(frozen=True)
class TextCloud:
    """A cloud that was read from a text file, with what had to be repaired.

    Parameters
    ----------
    xyz
        Points (n, 3).
    colours
        Colours (n, 3), uint8.
    repaired, dropped
        Numbers of damaged lines that were repaired and left out.
    """

    xyz: Floats
    colours: NDArray[np.uint8]
    repaired: int = 0
    dropped: int = 0


def read_xyzrgb(path: Path) -> TextCloud:
    """Read a coloured cloud from a text file with lines ``x y z r g b``, as in S3DIS.

    Damaged lines are repaired or left out. Bytes that no number contains are replaced by the digit
    0 or a space, such that the line has six numbers. Lines without six numbers, or with colours
    outside 0 to 255, are left out.

    Raises
    ------
    InputError
        No line is left.
    """
    data, repaired, dropped = _mended(read_bytes(path))
    rows = _parsed(data)
    if rows is None:
        rows, misfits = _complete_lines(data)
        dropped += misfits
    fits = _fitting(rows)
    if not fits.any():
        raise InputError(f"{path}: no lines of x y z r g b")
    dropped += int(np.count_nonzero(~fits))
    colours = np.rint(rows[fits, 3:]).astype(np.uint8)
    return TextCloud(rows[fits, :3], colours, repaired, dropped)


def _mended(data: bytes) -> tuple[bytes, int, int]:
    if not data.translate(None, _ALLOWED):
        return data, 0, 0
    pieces, done, repaired, dropped = [], 0, 0, 0
    for position in np.flatnonzero(_IS_FOREIGN[np.frombuffer(data, dtype=np.uint8)]).tolist():
        if position < done:
            continue
        start, end = data.rfind(b"\n", 0, position) + 1, data.find(b"\n", position)
        line = data[start:] if end < 0 else data[start:end]
        mended = next(filter(_is_row, _readings(line)), b"")
        pieces += [data[done:start], mended]
        done = start + len(line)
        repaired, dropped = repaired + bool(mended), dropped + (not mended)
    return b"".join([*pieces, data[done:]]), repaired, dropped


def _complete_lines(data: bytes) -> tuple[Floats, int]:
    lines = [line for line in data.splitlines() if line.strip()]
    kept = [[float(number) for number in line.split()] for line in lines if _is_row(line)]
    return np.array(kept, dtype=np.float64).reshape(-1, _COLUMNS), len(lines) - len(kept)


def _parsed(data: bytes) -> Floats | None:
    import pandas as pd

    if not data.strip():
        return np.empty((0, _COLUMNS))
    options: dict[str, Any] = {"sep": r"\s+", "header": None, "dtype": np.float64, "engine": "c"}
    try:
        rows = pd.read_csv(io.BytesIO(data), **options).to_numpy()
    except ValueError:  # pandas' ParserError is one
        return None
    return rows if rows.shape[1] == _COLUMNS else None


def _fitting(rows: Floats) -> NDArray[np.bool_]:
    colours = rows[:, 3:]
    in_range = (colours >= 0) & (colours <= 255)
    return np.asarray(np.isfinite(rows).all(axis=1) & in_range.all(axis=1))


def _readings(line: bytes) -> Iterator[bytes]:
    parts = _FOREIGN.split(line)  # good, foreign, good, ...
    good, foreign = parts[::2], parts[1::2]
    if len(foreign) > _MOST_RUNS:
        return
    choices = [
        (b"0" * len(run), b" ")
        if _ends_in_number(before) and _ends_in_number(after[:1])
        else (b" ",)
        for before, run, after in zip(good, foreign, good[1:], strict=False)
    ]
    for replacements in product(*choices):
        pairs = zip(good, (*replacements, b""), strict=True)
        yield b"".join(part for pair in pairs for part in pair)


def _ends_in_number(text: bytes) -> bool:
    return text != b"" and text[-1:] not in b" \t\r\n"


def _is_row(line: bytes) -> bool:
    if line.translate(None, _ALLOWED):
        return False
    try:
        numbers = [float(number) for number in line.split()]
    except ValueError:
        return False
    return len(numbers) == _COLUMNS and all(0 <= colour <= 255 for colour in numbers[3:])
