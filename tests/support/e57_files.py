"""E57 files with any fields, by the library's nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

NORMALS = ("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt")
DOUBLE = "double"
Kind = str | tuple[int, int]


@dataclass(frozen=True)
class Scan:
    """Columns by their names in E57, doubles or whole numbers between two; and the scan's pose.

    `intensities` are the limits of intensities, if stated.
    """

    columns: Mapping[str, tuple[Kind, Sequence[float]]]
    rotation: Mapping[str, float] = field(default_factory=dict)
    translation: Mapping[str, float] = field(default_factory=dict)
    intensities: tuple[float, float] | None = None


def cartesian(points: Any) -> dict[str, tuple[Kind, Sequence[float]]]:
    """Coordinates (n, 3) as columns."""
    return {
        f"cartesian{axis}": (DOUBLE, part)
        for axis, part in zip("XYZ", np.transpose(points), strict=True)
    }


def write_e57(path: Path, *scans: Scan) -> None:
    """Write a file."""
    import pye57

    with pye57.E57(str(path), mode="w") as file:
        file.image_file.extensionsAdd(*NORMALS)
        for number, scan in enumerate(scans):
            _write_scan(file, scan, number)


def _write_scan(file: Any, scan: Scan, number: int) -> None:
    from pye57 import libe57

    image = file.image_file
    node = libe57.StructureNode(image)
    node.set("guid", libe57.StringNode(image, f"{{{number}}}"))
    pose = libe57.StructureNode(image)
    for name, parts in (("rotation", scan.rotation), ("translation", scan.translation)):
        if parts:
            pose.set(
                name, _structure(image, {k: libe57.FloatNode(image, v) for k, v in parts.items()})
            )
    if scan.rotation or scan.translation:
        node.set("pose", pose)
    if scan.intensities is not None:
        ends = zip(("intensityMinimum", "intensityMaximum"), scan.intensities, strict=True)
        limits = {name: libe57.FloatNode(image, value) for name, value in ends}
        node.set("intensityLimits", _structure(image, limits))
    kinds = {name: _node(image, kind) for name, (kind, _) in scan.columns.items()}
    vector = libe57.CompressedVectorNode(
        image, _structure(image, kinds), libe57.VectorNode(image, True)
    )
    node.set("points", vector)
    file.data3d.append(node)
    arrays = {name: np.array(values, float) for name, (_, values) in scan.columns.items()}
    count = len(next(iter(arrays.values())))
    buffers = libe57.VectorSourceDestBuffer()
    for name, array in arrays.items():
        buffers.append(libe57.SourceDestBuffer(image, name, array, count, True, True))
    writer = vector.writer(buffers)
    writer.write(count)
    writer.close()


def _node(image: Any, kind: Kind) -> Any:
    from pye57 import libe57

    if kind == DOUBLE:
        return libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE)
    return libe57.IntegerNode(image, kind[0], *kind)


def _structure(image: Any, children: Mapping[str, Any]) -> Any:
    from pye57 import libe57

    node = libe57.StructureNode(image)
    for name, child in children.items():
        node.set(name, child)
    return node
