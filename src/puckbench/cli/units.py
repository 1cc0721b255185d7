"""Options that say how files of clouds and meshes are read, such as their unit."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cloud_files.clouds import read_unchecked_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud, UncheckedCloud
from pointkit.geometry.mesh import Mesh, scaled_mesh
from puckbench.cli.types import number_or_nan, positive, refuse
from puckbench.geometry.surfaces import read_surface

_DEFAULTS = {
    "metres_per_unit": 1,
    "drop_invalid": False,
    "keep_missing": False,
    "bin_columns": None,
}
"""Defaults of the options that apply only to clouds, not to scans and recordings."""


def metres_per_unit(words: Sequence[str]) -> float | dict[str, float]:
    """Parse the words of the option ``--metres-per-unit``.

    Parameters
    ----------
    words
        One number for all files, or FILE=NUMBER for each file.

    Returns
    -------
    float or dict
        Metres per unit of all files, or of each file by name.

    Raises
    ------
    InputError
        A word is neither a number nor FILE=NUMBER, or a file is named twice.
    """
    if len(words) == 1 and not math.isnan(number := number_or_nan(words[0])):
        return number
    table: dict[str, float] = {}
    for word in words:
        name, _, text = word.rpartition("=")
        if not name or math.isnan(number := number_or_nan(text)):
            raise InputError(
                f"--metres-per-unit: '{word}' is neither a single number nor FILE=NUMBER"
            )
        if name in table:
            raise InputError(f"--metres-per-unit: '{name}' is given twice")
        table[name] = number
    return table


def add_unit(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the option ``--metres-per-unit``; `what` is the word for the file in the help text."""
    text = f"unit of the {what} (0.001: millimetres; default: 1)"
    parser.add_argument("--metres-per-unit", type=positive, default=1.0, help=text)


def add_cloud_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how clouds are read from files."""
    add = parser.add_argument
    add("--drop-invalid", action="store_true", help="leave out points that are not finite")
    add("--keep-missing", action="store_true", help="keep a sensor's missing returns as points")
    text = (
        "columns of .bin files: their number, 3 to 6, or their names, such as "
        "x,y,z,intensity,ring (default: from the values)"
    )
    add("--bin-columns", metavar="COLUMNS", help=text)


def refuse_cloud_options(options: argparse.Namespace, why: str) -> None:
    """Raise InputError, with the reason `why`, if an option was given that is only for clouds."""
    refuse(options, _DEFAULTS, why)


def surface_of(options: argparse.Namespace, path: Path) -> Mesh:
    """Return the mesh in a file, in m, as the options of `add_unit` say."""
    return scaled_mesh(read_surface(path), options.metres_per_unit)


def cloud_of(options: argparse.Namespace, path: Path) -> UncheckedCloud:
    """Return the cloud in a file, in its own unit, as the options of `add_cloud_options` say."""
    convert = options.metres_per_unit == 1
    missing = options.keep_missing, options.drop_invalid
    return read_unchecked_cloud(path, *missing, options.bin_columns, convert)


def in_unit_of(options: argparse.Namespace, cloud: PointCloud) -> PointCloud:
    """Return a cloud with coordinates that are converted to m as the options of `add_unit` say."""
    factor = options.metres_per_unit
    if factor == 1:
        return cloud
    about = {**cloud.about, "metres_per_unit": cloud.metres_per_unit * factor}
    return replace(cloud, xyz=cloud.xyz * factor, about=about)
