"""E57: normals, times, flags, states, poses; where the library is installed."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tests.corpus.case import Case, content
from tests.support.e57_files import DOUBLE, Scan, cartesian, write_e57

POINTS = np.array([(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)])
HALF = np.sqrt(0.5)
QUARTER_TURN = {"x": 0.0, "y": 0.0, "z": HALF, "w": HALF}
"""About z, with the parts of the quaternion in another order than the usual one."""
TURNED = np.array([(-2.0, 1.0, 3.0), (-5.0, 4.0, 6.0)])


def rich(path: Path) -> None:
    """Points with normals, times, a flag of the colours, and colours of 16 bits."""
    normals = {f"nor:normal{axis}": (DOUBLE, [axis == "X"] * 2) for axis in "XYZ"}
    colours = {f"color{name}": ((0, 65535), [0, 65535]) for name in ("Red", "Green", "Blue")}
    others = {"timeStamp": (DOUBLE, [0.5, 1.5]), "isColorInvalid": ((0, 1), [0, 1])}
    write_e57(path, Scan({**cartesian(POINTS), **normals, **colours, **others}, QUARTER_TURN))


def two_scans(path: Path) -> None:
    """Scans with other fields, of which one has a pose."""
    near = {**cartesian(POINTS[:1]), "timeStamp": (DOUBLE, [1.0])}
    far = Scan(cartesian(POINTS[:1]), translation={"z": 1.0, "y": 0.0, "x": 10.0})
    write_e57(path, Scan(near), far)


def spherical(path: Path) -> None:
    """Distance, azimuth and elevation; the last point is invalid."""
    parts = {"Range": [2.0, 2.0, 9.0], "Azimuth": [0.0, np.pi / 2, 0.0], "Elevation": [0.0] * 3}
    columns = {f"spherical{name}": (DOUBLE, values) for name, values in parts.items()}
    write_e57(path, Scan({**columns, "sphericalInvalidState": ((0, 2), [0, 0, 2])}))


def invalid(path: Path) -> None:
    """Three points, of which the scanner has no coordinates for the second."""
    points = [POINTS[0], (0.0, 0.0, 0.0), POINTS[1]]
    write_e57(path, Scan({**cartesian(points), "cartesianInvalidState": ((0, 2), [0, 1, 0])}))


def no_pose(path: Path) -> None:
    """A rotation of length zero."""
    write_e57(path, Scan(cartesian(POINTS), dict.fromkeys("wxyz", 0.0)))


CASES = [
    Case(
        "rich.e57",
        rich,
        "cloud",
        points=TURNED,
        fields={"timeStamp": [0.5, 1.5], "isColorInvalid": [0, 1]},
    ),
    Case(
        "two_scans.e57",
        two_scans,
        "cloud",
        points=[(1, 2, 3), (11, 2, 4)],
        fields={"scan": [0, 1]},
        warning="two_scans.e57: fields of no numbers or not of all scans are left out: timeStamp",
    ),
    Case("spherical.e57", spherical, "cloud", points=[(2, 0, 0), (0, 2, 0)], warning="1 "),
    Case("invalid.e57", invalid, "cloud", points=POINTS, warning="1 "),
    Case("no_pose.e57", no_pose, "cloud", error="no_pose.e57: .*an invalid pose"),
    Case("no_scan.e57", write_e57, "cloud", error="no_scan.e57: the cloud is empty"),
    Case("letters.e57", content(b"ASTM-E57"), "cloud", error="not a readable E57 file"),
]
if find_spec("pye57") is None:
    CASES.clear()
