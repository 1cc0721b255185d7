"""A small tree with the layout and quirks of 2D-3D-S, S3DIS v1.2 and the thesis's positions."""

from __future__ import annotations

import json
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

from tests.support.files import put

Point = tuple[float, float, float]

# Low and high corner in the frame of S3DIS, metres.
OFFICE = ((2.0, 3.0, 0.0), (6.0, 7.0, 3.0))
HALLWAY = ((6.0, 3.0, 0.0), (40.0, 5.0, 3.0))
# One hallway of S3DIS's Area_5; its western part is in area_5b, the other in area_5a.
LONG_HALLWAY = ((-8.0, 10.0, 0.0), (8.0, 12.0, 3.0))
WEST = ((-8.0, 10.0, 0.0), (0.0, 12.0, 3.0))
EAST = ((0.0, 10.0, 0.0), (8.0, 12.0, 3.0))

_FACES = ("1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6")
_SURFACES = ("floor", "ceiling", "wall", "wall", "wall", "wall")


def make_tree(root: Path) -> Path:
    """Write ``2D-3D-S``, ``S3DIS`` and ``positions`` into `root`: areas 1, 5a and 5b."""
    areas: dict[str, list[tuple[str, tuple[Point, Point]]]] = {
        "1": [("office_1_1", OFFICE), ("hallway_1_1", HALLWAY)],
        "5a": [("hallway_1_5", EAST)],
        "5b": [("hallway_1_5", WEST)],
    }
    for area, rooms in areas.items():
        write_mesh(root, area, rooms)
    cloud(root, "Area_1/office_1/office_1.txt", OFFICE)
    cloud(root, "Area_1/hallway_1/hallway_1.txt", HALLWAY)
    cloud(root, "Area_5/hallway_1/hallway_1.txt", LONG_HALLWAY)
    positions(root, "1", {"office_1_1": [3.0, 4.0, 1.4], "hallway_1_1": [5.5, 4.0, 1.4]})
    positions(root, "5a", {"hallway_1_5": [3.0, 11.0, 1.4]})
    positions(root, "5b", {"hallway_1_5": list(in_5b((-3.0, 11.0, 1.4)))})
    return root


def write_mesh(root: Path, area: str, rooms: Iterable[tuple[str, tuple[Point, Point]]]) -> None:
    """``semantic.obj`` of boxes, y up; then an unlabelled triangle and one without area."""
    lines = ["# Blender v2.76", "mtllib semantic.mtl", "o Area"]
    count = 0
    for room, (low, high) in rooms:
        corners = product((low[2], high[2]), (low[1], high[1]), (low[0], high[0]))
        lines += [_vertex(area, (x, y, z)) for z, y, x in corners]
        for number, (face, surface) in enumerate(zip(_FACES, _SURFACES, strict=True), start=1):
            corner_indices = " ".join(f"{int(index) + count}//1" for index in face.split())
            lines += [f"usemtl {surface}_{number}_{room}", "s off", f"f {corner_indices}"]
        count += 8
    if area == "1":
        lines += [_vertex(area, (3.0, 4.0 + 0.1 * step, 1.0 + step % 2)) for step in range(3)]
        lines += ["usemtl <UNK>_0_<UNK>_0_0", "f -1 -2 -3", "f -1 -1 -2"]
    put(root / "2D-3D-S" / f"area_{area}" / "3d" / "semantic.obj", "\n".join(lines) + "\n")


def _vertex(area: str, point: Point) -> str:
    x, y, z = in_5b(point) if area == "5b" else point
    return f"v {x:.6f} {z:.6f} {-y:.6f}"


def in_5b(point: Point) -> Point:
    """A point in the frame of area_5b: turned by 90 degrees and moved against S3DIS."""
    return (6.22617759 - point[1], point[0] + 4.09703582, point[2])


def cloud(root: Path, name: str, box: tuple[Point, Point]) -> None:
    """A room file of S3DIS, with the two corners of its box."""
    rows = [" ".join(f"{x:.3f}" for x in corner) + " 10 20 30\n" for corner in box]
    put(root / "S3DIS" / name, "".join(rows))


def positions(root: Path, area: str, rooms: dict[str, Any]) -> None:
    """A list of scanner positions, as the thesis's repository has it."""
    put(root / "positions" / f"locations_pruned{area}.json", json.dumps(rooms))


def pose(root: Path, name: str, content: Any, folder: str = "data/pose") -> None:
    """A pose file of area_1."""
    path = root / "2D-3D-S" / "area_1" / folder / f"camera_{name}_domain_pose.json"
    put(path, json.dumps(content))
