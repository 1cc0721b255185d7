"""The rows of published numbers: their columns, and the check that no condition is missing.

A row is one number: the value of a measure at one rate of one codec, or a printed BD-rate. Its
conditions stand in the same row. What a source does not say is `NOT_STATED`; what does not apply,
such as the peak of a time, is `NONE`. No cell is empty.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Mapping
from math import inf, isfinite, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pointkit.damage import reading
from pointkit.errors import InputError, among, naming
from pointkit.files import read_bytes

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    *("dataset", "cloud", "codec", "codec_version", "rate", "bpp", "measure", "value"),
    *("peak", "points", "frames", "resolution", "anchor", "anchor_version", "machine", "place"),
)
"""Columns of published rows.

``cloud`` is the name of a cloud, or `MEAN` or `MEDIAN` over ``frames`` clouds. ``bpp`` is bits per
point of the input, of what the measure compares: positions or an attribute. ``peak`` is that of a
PSNR, with its unit if this is metres (``30 m``). ``points`` is the number of points of a cloud
before coding, on average. ``resolution`` is the step or depth of the coordinates before coding.
``anchor`` and ``anchor_version`` are of BD-rates. ``place`` is the paper, table or file that has
the number.
"""
NOT_STATED, NONE = "not stated", "none"
MEAN, MEDIAN = "mean", "median"
BD_RATES = {"bd_rate_d1": "d1_psnr", "bd_rate_d2": "d2_psnr"}
"""Measures that are BD-rates in percent, with the quality that they compare."""
PSNRS = ("d1_psnr", "d2_psnr", "y_psnr", "yuv_psnr", "reflectance_psnr")
TIMES = ("encode_s", "decode_s")
_OTHERS = ("cd_plane", "hausdorff_sq_plane", "pcqm", "size_ratio")
MEASURES = (*PSNRS, *TIMES, *_OTHERS, *BD_RATES)
"""Measures of published rows. Those that puckbench measures too have the names of its results."""
COUNTERPARTS = {
    "G-PCC octree": "gpcc",
    "Draco": "draco",
    "PCGCv1": "pcgcv1",
    "PCGCv2": "pcgcv2",
    "RENO": "reno",
    "Cloudini": "cloudini",
}
"""Published codecs of which puckbench has its own version, with the names of these."""
_NUMBERS = ("bpp", "points", "frames")
_PEAK = re.compile(r"\d+(\.\d+)?( m)?")
_RATES = re.compile(r"(\w+)\.\.(\w+) against (\w+)\.\.(\w+)")


def rows_beside(module: str, digest: str) -> pd.DataFrame:
    """Return the rows of the CSV file that has the name of a module and lies beside it.

    Parameters
    ----------
    module
        Path of the module (its ``__file__``).
    digest
        SHA-256 of the CSV file.

    Raises
    ------
    InputError
        The file is missing or damaged, or has another digest.
    """
    path = Path(module).with_suffix(".csv")
    content = read_bytes(path)
    found = hashlib.sha256(content).hexdigest()
    if found != digest:
        raise InputError(f"{path.name} has the SHA-256 {found}, not the expected {digest}")
    with naming(path.name):
        return _rows(content)


def rows_of_file(path: Path) -> pd.DataFrame:
    """Return the rows of a user's CSV file; raise InputError if it is not valid."""
    with naming(path):
        table = _rows(read_bytes(path))
        check_rows(table)
    return table


def _rows(content: bytes) -> pd.DataFrame:
    import pandas as pd

    with reading("table of published numbers", UnicodeDecodeError, csv.Error):
        lines = list(csv.reader(io.StringIO(content.decode("utf-8"), newline=""), strict=True))
    if not lines or tuple(lines[0]) != COLUMNS:
        raise InputError(f"the first line is not {','.join(COLUMNS)}")
    for number, cells in enumerate(lines[1:], 2):
        if len(cells) != len(COLUMNS):
            raise InputError(f"line {number} has {len(cells)} cells, not {len(COLUMNS)}")
    table = pd.DataFrame(lines[1:], columns=list(COLUMNS))
    if table.empty:
        raise InputError("the table has no rows")
    for number, cells in enumerate(lines[1:], 2):
        with naming(f"line {number}"):
            _check_texts(dict(zip(COLUMNS, cells, strict=True)))
    for name in (*_NUMBERS, "value"):
        table[name] = [_number(text) for text in table[name]]
    return table


def check_rows(table: pd.DataFrame) -> None:
    """Raise InputError unless a table has all columns, a value in each row, and no empty cell."""
    if missing := [name for name in COLUMNS if name not in table]:
        raise InputError(f"no column {missing[0]!r}")
    for name in COLUMNS:
        if name not in _NUMBERS and (empty := np.flatnonzero(table[name].isin(["", nan]))).size:
            raise InputError(f"row {empty[0] + 1}: no {name}")


def _check_texts(row: Mapping[str, str]) -> None:
    """Raise InputError unless a line of a file has every condition that its measure needs."""
    if empty := [name for name in COLUMNS if not row[name].strip()]:
        raise InputError(f"no {empty[0]} (write '{NOT_STATED}' if the source does not say it)")
    measure = row["measure"]
    if measure not in MEASURES:
        raise InputError(f"unknown measure '{measure}'{among(measure, MEASURES)}")
    if measure in BD_RATES:
        rates_of(row["rate"])
    _check_numbers(row)
    needed = {
        "peak": measure in PSNRS,
        "anchor": measure in BD_RATES,
        "anchor_version": measure in BD_RATES,
        "machine": measure in TIMES,
    }
    for name, is_needed in needed.items():
        if (row[name] != NONE) != is_needed:
            raise InputError(f"{measure} with the {name} {row[name]!r}")


def _check_numbers(row: Mapping[str, str]) -> None:
    for name in _NUMBERS:
        if row[name] not in (NOT_STATED, NONE) and not _number(row[name]) > 0:
            raise InputError(f"{name} {row[name]!r} is not a number above 0")
    if isnan(_number(row["value"])):
        raise InputError(f"value {row['value']!r} is not a number")
    if row["peak"] not in (NONE, NOT_STATED) and not _PEAK.fullmatch(row["peak"]):
        raise InputError(f"peak {row['peak']!r} is not a number, with or without the unit m")


def rates_of(text: str) -> tuple[tuple[str, str], tuple[str, str]]:
    """Return the first and last rates that a BD-rate compares: of the codec, and of its anchor.

    Parameters
    ----------
    text
        The cell ``rate`` of a BD-rate, such as ``R0..R5 against R1..R5``.
    """
    found = _RATES.fullmatch(text)
    if found is None:
        raise InputError(f"rate {text!r} is not like 'R0..R5 against R1..R5'")
    return (found[1], found[2]), (found[3], found[4])


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return nan
    return value if isfinite(value) or value == inf else nan
