"""GLB files: scenes in binary glTF 2.0 (Khronos Group 2021), read as one mesh."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.meshes.polygons import Polygons, uniform_polygons
from pointkit.damage import reading
from pointkit.errors import InputError, naming
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats, Ints

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_JSON, _BINARY = b"JSON", b"BIN\0"
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_HARMLESS = (
    *("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization", "EXT_texture_"),
)
"""Prefixes of extensions that are supported or do not affect the triangles."""
_DAMAGE = (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError)
_MIN_BYTES, _BYTES_PER_BYTE = 512 << 20, 10
"""Memory limit of a scene: the larger of 512 MiB and 10 times the file's size."""
_IDENTITY = np.eye(4)


def read_glb(path: Path) -> Polygons:
    """Read all triangles of a GLB scene, in metres with y up.

    The triangles are transformed as their nodes say; a mesh that several nodes use is repeated.
    Lines and points are left out, and their number is returned in ``skipped``. Raises InputError if
    the file is damaged, if it needs other files, compression or instancing, or if the scene would
    take more memory than the larger of 512 MiB and ten times the file's size.
    """
    data = read_bytes(path)
    try:
        with naming(path), reading("GLB file", *_DAMAGE):
            scene = _Scene(*_chunks(data))
            scene.check()
            parts = list(scene.parts())
    except RecursionError as error:
        raise InputError(f"{path}: not a readable GLB file (nested too deeply)") from error
    if not parts:
        raise InputError(f"{path}: the mesh has no faces")
    counts = np.array([len(vertices) for vertices, _ in parts])
    shifts = np.cumsum(counts) - counts
    faces = np.concatenate([f + shift for (_, f), shift in zip(parts, shifts, strict=True)])
    polygons = uniform_polygons(np.concatenate([vertices for vertices, _ in parts]), faces)
    return replace(polygons, up="y", skipped=dict(scene.skipped))


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    if data[:4] != b"glTF":
        raise InputError("not a GLB file")
    version, length = (int.from_bytes(data[at : at + 4], "little") for at in (4, 8))
    if version != 2:
        raise InputError(f"glTF {version} is not read, only glTF 2")
    if len(data) < length:
        raise InputError("the GLB file is truncated")
    chunks: dict[bytes, bytes] = {}
    start = 12
    while start + 8 <= length:
        size, kind = int.from_bytes(data[start : start + 4], "little"), data[start + 4 : start + 8]
        if start + 8 + size > length:
            raise InputError("a chunk of the GLB file is truncated")
        chunks.setdefault(kind, data[start + 8 : start + 8 + size])
        start += 8 + size
    tree = json.loads(chunks.get(_JSON, b""))
    if not isinstance(tree, dict):
        raise ValueError("its JSON is not an object")
    return tree, chunks.get(_BINARY, b"")


class _Scene:
    def __init__(self, tree: dict[str, Any], binary: bytes) -> None:
        self.tree, self.binary = tree, binary
        self.skipped: Counter[str] = Counter()
        self._nodes = tree.get("nodes", [])
        self._bytes_left = max(_MIN_BYTES, _BYTES_PER_BYTE * len(binary))

    def check(self) -> None:
        required = self.tree.get("extensionsRequired", ())
        of_nodes = (name for node in self._nodes for name in node.get("extensions", ()))
        instancing = [name for name in of_nodes if name == "EXT_mesh_gpu_instancing"]
        for name in (*required, *instancing):
            if not name.startswith(_HARMLESS):
                raise InputError(f"{name} is not read: export the file without it")
        if any("uri" in buffer for buffer in self.tree.get("buffers", ())):
            raise InputError("its buffers are not within it: export them into the GLB file")

    def parts(self) -> Iterator[tuple[Floats, Ints]]:
        cache: dict[int, list[tuple[Floats, Ints]]] = {}
        for mesh, matrix in self._mesh_poses():
            if mesh not in cache:
                cache[mesh] = list(self._primitives(self.tree["meshes"][mesh]))
            for vertices, triangles in cache[mesh]:
                self._count_bytes(vertices.nbytes + triangles.nbytes)
                yield _transformed(vertices, triangles, matrix)

    def _mesh_poses(self) -> Iterator[tuple[int, Floats]]:
        nodes, scenes = self._nodes, self.tree.get("scenes")
        roots = scenes[self.tree.get("scene", 0)].get("nodes", []) if scenes else _roots(nodes)
        stack = [(root, _IDENTITY) for root in reversed(roots)]
        visited: set[int] = set()
        while stack:
            number, parent = stack.pop()
            if number in visited:
                raise InputError(f"node {number} has two parents")
            visited.add(number)
            node = nodes[number]
            matrix = parent @ _matrix(node)
            if "mesh" in node:
                yield node["mesh"], matrix
            stack += [(child, matrix) for child in reversed(node.get("children", []))]

    def _primitives(self, mesh: dict[str, Any]) -> Iterator[tuple[Floats, Ints]]:
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", _TRIANGLES)
            if mode not in (_TRIANGLES, _STRIP, _FAN):
                self.skipped["primitives_without_faces"] += 1
                continue
            vertices = self._accessor(primitive["attributes"]["POSITION"], "VEC3")
            indices = np.arange(len(vertices))
            if "indices" in primitive:
                indices = self._accessor(primitive["indices"], "SCALAR")
            triangles = _triangles(indices.reshape(-1).astype(np.int64), mode)
            if triangles.size and triangles.max() >= len(vertices):
                raise InputError("a face refers to a vertex that does not exist")
            yield vertices.astype(np.float64), triangles

    def _accessor(self, number: int, kind: str) -> NDArray[Any]:
        accessor = self.tree["accessors"][number]
        count, component = int(accessor["count"]), _COMPONENTS[accessor["componentType"]]
        if accessor["type"] != kind:
            raise ValueError(f"accessor {number} is not a {kind}")
        shape = (count, _WIDTHS[kind])
        self._count_bytes(8 * math.prod(shape))
        rows: NDArray[Any] = np.zeros(shape, dtype=component)
        if "bufferView" in accessor:
            rows = self._rows(accessor, component, shape).copy()
        if sparse := accessor.get("sparse"):
            count = int(sparse["count"])
            index_type = _COMPONENTS[sparse["indices"]["componentType"]]
            indices = self._rows(sparse["indices"], index_type, (count,))
            rows[indices] = self._rows(sparse["values"], component, (count, shape[1]))
        return _normalised(rows) if accessor.get("normalized") else rows

    def _count_bytes(self, size: int) -> None:
        self._bytes_left -= size
        if self._bytes_left < 0:
            raise InputError("its scene is too large for a file of this size")

    def _rows(self, source: dict[str, Any], component: str, shape: tuple[int, ...]) -> NDArray[Any]:
        view = self.tree["bufferViews"][source["bufferView"]]
        if view.get("buffer", 0) != 0:
            raise InputError("its buffers are not within it")
        start = int(view.get("byteOffset", 0))
        data = memoryview(self.binary)[start : start + int(view["byteLength"])]
        dtype = np.dtype(component)
        packed = dtype.itemsize * math.prod(shape[1:])
        strides = (int(view.get("byteStride") or packed), dtype.itemsize)[: len(shape)]
        return np.ndarray(shape, dtype, data, int(source.get("byteOffset", 0)), strides)


def _roots(nodes: list[dict[str, Any]]) -> list[int]:
    children = {child for node in nodes for child in node.get("children", ())}
    return [number for number in range(len(nodes)) if number not in children]


def _matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    if not {"translation", "rotation", "scale"} & set(node):
        return _IDENTITY
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    rotation = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _transformed(vertices: Floats, triangles: Ints, matrix: Floats) -> tuple[Floats, Ints]:
    transformed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return transformed, triangles[:, ::-1] if np.linalg.det(matrix) < 0 else triangles


def _triangles(indices: Ints, mode: int) -> Ints:
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    first = np.arange(max(len(indices) - 2, 0))
    if mode == _FAN:
        return indices[np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)]
    odd = first % 2
    return indices[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]


def _normalised(rows: NDArray[Any]) -> Floats:
    if rows.dtype.kind == "f":
        return rows
    return np.maximum(rows / np.iinfo(rows.dtype).max, -1.0)
