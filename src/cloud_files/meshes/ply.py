"""PLY files of meshes, and the descriptions (JSON) beside them, which name the parts of scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.descriptions import read_description, sidecar, write_description
from cloud_files.meshes.polygons import Polygons
from cloud_files.ply import CORNER_LISTS, read_elements
from pointkit.errors import InputError
from pointkit.files import written_whole
from pointkit.geometry.cloud import Floats, Ints
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject, check_mesh

_IDS = ("object_id", "primitive_id")
"""Properties of faces, and the attributes of `Labels` that they hold."""


def read_ply(path: Path) -> Polygons:
    """Read the faces of a PLY file, with their labels if `write_mesh` wrote the file."""
    elements = read_elements(path)
    names = {element.name for element in elements}
    if "tristrips" in names and "face" not in names:
        raise InputError(f"{path}: its faces are triangle strips, which are not read: export faces")
    if not {"vertex", "face"} <= names:
        raise InputError(f"{path}: a cloud, not a mesh: the PLY file has no faces")
    faces = np.asarray(elements["face"].data)
    corners, sizes = _face_corners(path, faces)
    labels = _labels(path, faces, len(elements["vertex"].data))
    return Polygons(_vertices(path, elements["vertex"].data), corners, sizes, labels=labels)


def _vertices(path: Path, rows: NDArray[Any]) -> Floats:
    if not {"x", "y", "z"} <= set(rows.dtype.names or ()):
        raise InputError(f"{path}: the vertices have no x, y, z")
    axes = [rows[axis] for axis in "xyz"]
    if any(axis.dtype == object for axis in axes):
        raise InputError(f"{path}: x, y, z of the vertices are not numbers")
    return np.stack(axes, axis=1).astype(np.float64)


def _face_corners(path: Path, rows: NDArray[Any]) -> tuple[Ints, Ints]:
    name = next((name for name in CORNER_LISTS if name in (rows.dtype.names or ())), None)
    if name is None:
        raise InputError(f"{path}: the faces have no vertex_indices")
    lists = rows[name]
    if lists.dtype == object:
        sizes = np.fromiter((len(corners) for corners in lists), dtype=np.int64, count=len(lists))
        joined = np.concatenate([np.empty(0, dtype=np.int64), *lists])
    elif lists.ndim == 2:
        joined = lists.reshape(-1)
        sizes = np.full(len(lists), lists.shape[1], dtype=np.int64)
    else:
        raise InputError(f"{path}: {name} of the faces is not a list")
    if joined.dtype.kind not in "iu":
        raise InputError(f"{path}: {name} of the faces are not integers")
    return joined.astype(np.int64), sizes


def _labels(path: Path, rows: NDArray[Any], vertices: int) -> Labels | None:
    if not set(_IDS) <= set(rows.dtype.names or ()):
        return None
    about = read_description(path, {"triangles": len(rows), "vertices": vertices})
    if about is None:
        return None
    try:
        objects = tuple(SceneObject(item["name"], item["semantic"]) for item in about["objects"])
        kinds = ((item["kind"], item["parameters"]) for item in about["primitives"])
        primitives = tuple(Primitive(*each) for each in kinds)
    except (KeyError, TypeError) as error:
        raise InputError(f"{sidecar(path)}: does not describe the labels of {path}") from error
    object_id, primitive_id = (rows[name].astype(np.int32) for name in _IDS)
    _check_ids(path, object_id, len(objects))
    _check_ids(path, primitive_id, len(primitives))
    return Labels(object_id, primitive_id, objects, primitives)


def _check_ids(path: Path, ids: NDArray[np.int32], count: int) -> None:
    if len(ids) and (ids.min() < 0 or ids.max() >= count):
        raise InputError(f"{path}: a face has a label that {sidecar(path).name} does not list")


def write_mesh(path: str | Path, mesh: Mesh, about: dict[str, Any] | None = None) -> None:
    """Write a mesh as a binary PLY file, and a description of it beside the PLY file.

    Both files appear only when both are complete.

    Parameters
    ----------
    path
        The PLY file. The description has the same name, but ends in ``.json``.
    mesh
        Vertices are written as float64, so that they are read back exactly. If the mesh has
        labels, each face has the properties ``object_id`` and ``primitive_id``, and the
        description lists the objects and primitives that they count.
    about
        Further entries of the description: values that JSON can represent.

    Raises
    ------
    InputError
        The mesh is empty, without area or not finite, or the files cannot be written.
    """
    path = Path(path)
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
    labels = [f"property int {name}" for name in _IDS] if mesh.labels else []
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
    labels = _IDS if mesh.labels else ()
    fields: list[Any] = [("size", "u1"), ("corners", "<i4", 3), *((name, "<i4") for name in labels)]
    rows = np.empty(len(mesh.triangles), dtype=fields)
    rows["size"], rows["corners"] = 3, mesh.triangles
    for name in labels:
        rows[name] = getattr(mesh.labels, name)
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
