"""Calibration of an individual HDL-64E: from its packets, VeloView's XML or ROS's YAML files.

Each packet holds one byte of the calibration, and the whole repeats every 4,160 packets (HDL-64E S3
User's Manual 63-HDL64ES3, Appendix E; also the S2). The corrections of intensities (focal distance
and slope) are not applied.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError, naming
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats

LASERS = 64
_MESSAGE_BYTES, _LASER_BYTES = 1820, 28
_START = b"UNIT#"
_FIRST_LASER = 7
_STATES = b"HMSDNYGTV"
"""Types of packets that state time, temperature, GPS or firmware, and no calibration."""
_S3_TYPE = ord("W")
_OF_LASER = np.dtype([("laser", "u1"), ("values", "<i2", 7)])
_PER_UNIT = np.array([100, 100, 1, 1, 1, 1, 1])
"""Units of the values per degree or millimetre, in the order of `_DB_NAMES`."""
_DB_NAMES = (
    "vertCorrection", "rotCorrection", "distCorrection", "distCorrectionX", "distCorrectionY",
    "vertOffsetCorrection", "horizOffsetCorrection",
)  # fmt: skip
_ROS_NAMES = (
    "vert_correction", "rot_correction", "dist_correction", "dist_correction_x",
    "dist_correction_y", "vert_offset_correction", "horiz_offset_correction",
)  # fmt: skip


def calibration_in_packets(status: NDArray[np.uint8]) -> dict[str, Any] | None:
    """Return the calibration that a sensor sends in its packets.

    Parameters
    ----------
    status
        The last two bytes of each packet, (p, 2).

    Returns
    -------
    dict or None
        Fields of a `Sensor` by name; None if the calibration is incomplete.
    """
    message = status[~np.isin(status[:, 0], list(_STATES)), 1].tobytes()
    for match in re.finditer(re.escape(_START), message):
        body = message[match.start() : match.start() + _MESSAGE_BYTES]
        end = _FIRST_LASER + LASERS * _LASER_BYTES
        if len(body) < end:
            return None
        rows = np.frombuffer(body[_FIRST_LASER:end], np.uint8).reshape(LASERS, _LASER_BYTES)
        lasers = np.ascontiguousarray(rows[:, : _OF_LASER.itemsize]).view(_OF_LASER)[:, 0]
        if (lasers["laser"] == np.arange(LASERS)).all():  # no packet is missing
            return _fields(lasers["values"] / _PER_UNIT)
    return None


def calibration_beside(recording: Path) -> Path | None:
    """Return the calibration file beside a recording; None if there is none.

    It has the recording's name with the suffix .xml, .yaml or .yml.
    """
    paths = (recording.with_suffix(suffix) for suffix in (".xml", ".yaml", ".yml"))
    return next((path for path in paths if path.is_file() and path != recording), None)


def is_s3(status: NDArray[np.uint8]) -> bool:
    """Return whether packets come from an HDL-64E S3, in contrast to an S2.

    Parameters
    ----------
    status
        The last two bytes of each packet, (p, 2).
    """
    return bool((status[:, 0] == _S3_TYPE).any())


def read_calibration(path: Path) -> dict[str, Any]:
    """Read a calibration from VeloView's XML file (db.xml), as fields of a `Sensor` by name."""
    text = read_bytes(path).decode("utf-8", "replace")
    points = re.findall(r"<px\b.*?</px>", text, re.DOTALL)
    lasers = [dict(re.findall(r"<(\w+)_>\s*([^<\s]+)\s*</\1_>", point)) for point in points]
    degrees, millimetres = 1.0, 10.0
    with naming(path):
        return _parsed(lasers, "id", _DB_NAMES, degrees, millimetres)


def calibration_of_ros(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the calibration in the content of velodyne_pointcloud's YAML file.

    Parameters
    ----------
    options
        Content of the YAML file.

    Returns
    -------
    dict
        Fields of a `Sensor` by name.
    """
    return _parsed(options["lasers"], "laser_id", _ROS_NAMES, 180 / np.pi, 1000.0)


def _parsed(
    lasers: Iterable[Mapping[str, Any]],
    number: str,
    names: tuple[str, ...],
    degrees: float,
    millimetres: float,
) -> dict[str, Any]:
    units = [degrees] * 2 + [millimetres] * 5
    try:
        numbered = {
            int(laser[number]): [
                round(float(laser[name] if unit == degrees else laser.get(name, 0.0)) * unit, 6)
                for name, unit in zip(names, units, strict=True)
            ]
            for laser in lasers
        }
        rows = [numbered[laser] for laser in range(LASERS)]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"not the calibration of an HDL-64E, with {LASERS} lasers") from error
    return _fields(np.array(rows))


def _fields(lasers: Floats) -> dict[str, Any]:
    elevation, rotation, far, x, y, height, sideways = lasers.T
    is_near = (x != 0) & (y != 0)  # without both near corrections, the far one applies everywhere
    columns = {
        "laser_elevation_deg": elevation,
        "laser_azimuth_deg": -rotation,
        "vertical_correction_mm": height,
        "horizontal_correction_mm": sideways,
        "distance_correction_mm": far,
        "distance_correction_x_mm": np.where(is_near, x, far),
        "distance_correction_y_mm": np.where(is_near, y, far),
    }
    return {name: tuple(column.tolist()) for name, column in columns.items()}
