from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.descriptions import write_description
from pointkit.files import written_whole
from pointkit.geometry.mesh import Labels, Mesh, check_mesh

LABELS = [("object_id", "<i4"), ("primitive_id", "<i4")]


def write_mesh(path: Path, mesh: Mesh, about: dict[str, Any] | None = None) -> None:
    """Write a binary PLY (float64 vertices, labelled faces), and `about` as JSON beside the PLY."""
    check_mesh(mesh, str(path))
    counts = {"vertices": len(mesh.vertices), "triangles": len(mesh.triangles)}
    vertices = np.ascontiguousarray(mesh.vertices, dtype="<f8")
    with written_whole(path) as temporary:
        with temporary.open("wb") as stream:
            stream.write(_header(mesh))
            stream.write(vertices.tobytes())
            stream.write(_face_rows(mesh).tobytes())
        description = {**(about or {}), **counts, **_label_description(mesh.labels)}
        write_description(path, "mesh", description)


def _header(mesh: Mesh) -> bytes:
    labels = [f"property int {name}" for name, _ in LABELS] if mesh.labels else []
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(mesh.vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(mesh.triangles)}",
        "property list uchar int vertex_indices",
        *labels,
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode()


def _face_rows(mesh: Mesh) -> NDArray[Any]:
    fields: list[Any] = [("size", "u1"), ("corners", "<i4", 3), *(LABELS if mesh.labels else [])]
    rows = np.empty(len(mesh.triangles), dtype=fields)
    rows["size"] = 3
    rows["corners"] = mesh.triangles
    if mesh.labels:
        rows["object_id"] = mesh.labels.object_id
        rows["primitive_id"] = mesh.labels.primitive_id
    return rows


def _label_description(labels: Labels | None) -> dict[str, Any]:
    if labels is None:
        return {}
    objects = [{"name": item.name, "semantic": item.semantic} for item in labels.objects]
    primitives = [
        {"kind": item.kind, "parameters": {k: _for_json(v) for k, v in item.parameters.items()}}
        for item in labels.primitives
    ]
    return {"objects": objects, "primitives": primitives}


def _for_json(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
