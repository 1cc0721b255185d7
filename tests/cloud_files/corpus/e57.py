"""E57: normals, times, flags, states, poses; where the library is installed."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tests.support.corpus_case import Case, content
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


_ELSEWHERE = {"x": 10.0, "y": 0.0, "z": 0.0}
THERE = POINTS + np.array([10.0, 0.0, 0.0])


def no_returns(path: Path) -> None:
    """Firings without a return at the position of each of two scanners, of which one has moved."""
    points = cartesian([*POINTS, *np.zeros((3, 3))])
    write_e57(path, Scan(points), Scan(points, translation=_ELSEWHERE))


def no_return_of_an_image(path: Path) -> None:
    """Among 2,000 points of an image, one without a return."""
    points = np.column_stack([np.arange(2001.0), np.ones((2001, 2))])
    points[7] = 0
    image = {f"{name}Index": ((0, 2000), np.arange(2001.0).tolist()) for name in ("row", "column")}
    write_e57(path, Scan({**cartesian(points), **image}, translation=_ELSEWHERE))


def no_range(path: Path) -> None:
    """Distances, of which two are 0; the state of the third stands under the other name."""
    parts = {"Range": [2.0, 0.0, 0.0, 9.0], "Azimuth": [0.0, 1.0, 2.0, 3.0], "Elevation": [0.0] * 4}
    columns = {f"spherical{name}": (DOUBLE, values) for name, values in parts.items()}
    state = {"cartesianInvalidState": ((0, 2), [0, 0, 0, 2])}
    write_e57(path, Scan({**columns, **state}, QUARTER_TURN, _ELSEWHERE))


def colours(path: Path) -> None:
    """Scans whose colours have 8 bits and 16 bits."""
    names = ("Red", "Green", "Blue")
    deep = {f"color{name}": ((0, 65535), [0, 65535]) for name in names}
    flat = {f"color{name}": ((0, 255), [0, 255]) for name in names}
    write_e57(path, *(Scan({**cartesian(POINTS), **each}) for each in (flat, deep)))


def limits(path: Path) -> None:
    """Scans with intensities of 8 and of 16 bits."""
    scans = [
        Scan({**cartesian(POINTS[:1]), "intensity": (DOUBLE, [most])}, intensities=(0.0, most))
        for most in (255.0, 65535.0)
    ]
    write_e57(path, *scans)


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
    Case("no_returns.e57", no_returns, "cloud", points=[*POINTS, *THERE], warning="6 of 10 points"),
    Case(
        "no_returns_kept.e57",
        no_returns,
        "cloud",
        points=[*POINTS, *[(0, 0, 0)] * 3, *THERE, *[(10, 0, 0)] * 3],
        options={"keep_missing": True},
    ),
    Case(
        "no_return_of_an_image.e57",
        no_return_of_an_image,
        "cloud",
        points=[(x + 10, 1, 1) for x in range(2001) if x != 7],
        warning="1 of 2001 points are missing returns",
    ),
    Case("no_range.e57", no_range, "cloud", points=[(10, 2, 0)], warning="3 of 4 points"),
    Case(
        "colours.e57",
        colours,
        "cloud",
        points=[*POINTS, *POINTS],
        fields={"scan": [0, 0, 1, 1]},
    ),
    Case(
        "limits.e57",
        limits,
        "cloud",
        points=[POINTS[0], POINTS[0]],
        fields={"intensity": [255, 65535]},
        warning="intensities of different limits, kept as they are",
    ),
    Case("no_pose.e57", no_pose, "cloud", error="no_pose.e57: .*an invalid pose"),
    Case("no_scan.e57", write_e57, "cloud", error="no_scan.e57: the cloud is empty"),
    Case("letters.e57", content(b"ASTM-E57"), "cloud", error="not a readable E57 file"),
]
if find_spec("pye57") is None:
    CASES.clear()
