"""Reading GLB (binary glTF 2.0) scenes as one mesh.

References
----------
Khronos Group, glTF 2.0 Specification, 2021.
"""

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

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.geometry.cloud import Floats
from puckbench.io.meshes.polygons import Integers, Polygons, uniform

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_JSON, _BINARY = b"JSON", b"BIN\0"
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_PLAIN = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization", "EXT_texture_")
"""Beginnings of extensions that do not change where the triangles are, or that are read."""
_DAMAGE = (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError)
_BYTES, _BYTES_A_BYTE = 512 << 20, 10
"""Of arrays that a scene may fill: so many, or so many for each byte of its file."""
_IDENTITY = np.eye(4)


def read_glb(path: Path) -> Polygons:
    """Read every mesh of a GLB file's scene, placed by its node; glTF is metres with y up.

    Primitives without triangles (lines, points) are counted as skipped. Draco and meshopt
    compression, buffers in other files and instancing by extension are refused.
    """
    data = read_bytes(path)
    try:
        scene = _Scene(*_chunks(data, path), path)
        scene.check()
        parts = list(scene.parts())
    except _DAMAGE as error:
        fault = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: not a readable GLB file ({fault})") from error
    except RecursionError as error:
        raise InputError(f"{path}: not a readable GLB file (nested too deeply)") from error
    if not parts:
        raise InputError(f"{path}: the mesh has no faces")
    counts = np.array([len(vertices) for vertices, _ in parts])
    shifts = np.cumsum(counts) - counts
    faces = np.concatenate([f + shift for (_, f), shift in zip(parts, shifts, strict=True)])
    joined = uniform(np.concatenate([vertices for vertices, _ in parts]), faces)
    return replace(joined, up="y", skipped=dict(scene.skipped))


def _chunks(data: bytes, path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON chunk of a GLB file, and its binary chunk, which may be empty."""
    if data[:4] != b"glTF":
        raise InputError(f"{path}: not a GLB file")
    version, length = (int.from_bytes(data[at : at + 4], "little") for at in (4, 8))
    if version != 2:
        raise InputError(f"{path}: glTF {version} is not read, only glTF 2")
    if len(data) < length:
        raise InputError(f"{path}: the GLB file is truncated")
    chunks: dict[bytes, bytes] = {}
    start = 12
    while start + 8 <= length:
        size, kind = int.from_bytes(data[start : start + 4], "little"), data[start + 4 : start + 8]
        if start + 8 + size > length:
            raise InputError(f"{path}: a chunk of the GLB file is truncated")
        chunks.setdefault(kind, data[start + 8 : start + 8 + size])
        start += 8 + size
    tree = json.loads(chunks.get(_JSON, b""))
    if not isinstance(tree, dict):
        raise ValueError("its JSON is not an object")
    return tree, chunks.get(_BINARY, b"")


class _Scene:
    """The tree and the bytes of a GLB file, and what of it has been left out."""

    def __init__(self, tree: dict[str, Any], binary: bytes, path: Path) -> None:
        self.tree, self.binary, self.path = tree, binary, path
        self.skipped: Counter[str] = Counter()
        self._nodes = tree.get("nodes", [])
        self._left = max(_BYTES, _BYTES_A_BYTE * len(binary))

    def check(self) -> None:
        """InputError where the triangles are not in this file, or not as the plain format says."""
        required = self.tree.get("extensionsRequired", ())
        of_nodes = (name for node in self._nodes for name in node.get("extensions", ()))
        instancing = [name for name in of_nodes if name == "EXT_mesh_gpu_instancing"]
        for name in (*required, *instancing):
            if not name.startswith(_PLAIN):
                raise InputError(f"{self.path}: {name} is not read: export the file without it")
        if any("uri" in buffer for buffer in self.tree.get("buffers", ())):
            raise InputError(
                f"{self.path}: its buffers are not within it: export them into the GLB file"
            )

    def parts(self) -> Iterator[tuple[Floats, Integers]]:
        """Vertices (v, 3) and triangles (t, 3) of each primitive that a node of the scene shows."""
        cached: dict[int, list[tuple[Floats, Integers]]] = {}
        for mesh, matrix in self._placed():
            if mesh not in cached:
                cached[mesh] = list(self._primitives(self.tree["meshes"][mesh]))
            for vertices, triangles in cached[mesh]:
                self._take(vertices.nbytes + triangles.nbytes)
                yield _moved(vertices, triangles, matrix)

    def _placed(self) -> Iterator[tuple[int, Floats]]:
        """Each mesh that a node of the scene has, with the matrix (4, 4) from it to the scene."""
        nodes, scenes = self._nodes, self.tree.get("scenes")
        roots = scenes[self.tree.get("scene", 0)].get("nodes", []) if scenes else _roots(nodes)
        waiting = [(root, _IDENTITY) for root in reversed(roots)]
        seen: set[int] = set()
        while waiting:
            number, parent = waiting.pop()
            if number in seen:
                raise InputError(f"{self.path}: node {number} has two parents")
            seen.add(number)
            node = nodes[number]
            matrix = parent @ _matrix(node)
            if "mesh" in node:
                yield node["mesh"], matrix
            waiting += [(child, matrix) for child in reversed(node.get("children", []))]

    def _primitives(self, mesh: dict[str, Any]) -> Iterator[tuple[Floats, Integers]]:
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
                raise InputError(f"{self.path}: a face refers to a vertex that does not exist")
            yield vertices.astype(np.float64), triangles

    def _accessor(self, number: int, kind: str) -> NDArray[Any]:
        """The rows (n, width) of an accessor."""
        accessor = self.tree["accessors"][number]
        count, component = int(accessor["count"]), _COMPONENTS[accessor["componentType"]]
        if accessor["type"] != kind:
            raise ValueError(f"accessor {number} is not a {kind}")
        shape = (count, _WIDTHS[kind])
        self._take(8 * math.prod(shape))
        rows: NDArray[Any] = np.zeros(shape, dtype=component)
        if "bufferView" in accessor:
            rows = self._rows(accessor, component, shape).copy()
        if sparse := accessor.get("sparse"):
            changed = int(sparse["count"])
            indices = _COMPONENTS[sparse["indices"]["componentType"]]
            where = self._rows(sparse["indices"], indices, (changed,))
            rows[where] = self._rows(sparse["values"], component, (changed, shape[1]))
        return _dequantised(rows) if accessor.get("normalized") else rows

    def _take(self, size: int) -> None:
        """Count bytes of arrays; InputError where a small file would fill the memory."""
        self._left -= size
        if self._left < 0:
            raise InputError(f"{self.path}: its scene is too large for a file of this size")

    def _rows(self, place: dict[str, Any], component: str, shape: tuple[int, ...]) -> NDArray[Any]:
        """An array that lies in a buffer view; ValueError or TypeError where it leaves it."""
        view = self.tree["bufferViews"][place["bufferView"]]
        if view.get("buffer", 0) != 0:
            raise InputError(f"{self.path}: its buffers are not within it")
        start = int(view.get("byteOffset", 0))
        inside = memoryview(self.binary)[start : start + int(view["byteLength"])]
        dtype = np.dtype(component)
        packed = dtype.itemsize * math.prod(shape[1:])
        strides = (int(view.get("byteStride") or packed), dtype.itemsize)[: len(shape)]
        return np.ndarray(shape, dtype, inside, int(place.get("byteOffset", 0)), strides)


def _roots(nodes: list[dict[str, Any]]) -> list[int]:
    """Nodes without a parent, which are shown where the file names no scene."""
    children = {child for node in nodes for child in node.get("children", ())}
    return [number for number in range(len(nodes)) if number not in children]


def _matrix(node: dict[str, Any]) -> Floats:
    """From a node to its parent, (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    if not {"translation", "rotation", "scale"} & set(node):
        return _IDENTITY
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    turn = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _moved(vertices: Floats, triangles: Integers, matrix: Floats) -> tuple[Floats, Integers]:
    """A part of the scene in its place; a mirrored one keeps its front."""
    placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return placed, triangles[:, ::-1] if np.linalg.det(matrix) < 0 else triangles


def _triangles(indices: Integers, mode: int) -> Integers:
    """Triangles (t, 3) of the corners of a list, a strip or a fan."""
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    first = np.arange(max(len(indices) - 2, 0))
    if mode == _FAN:
        return indices[np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)]
    odd = first % 2
    return indices[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]


def _dequantised(rows: NDArray[Any]) -> Floats:
    """Integers as numbers from -1, or 0, to 1."""
    if rows.dtype.kind == "f":
        return rows
    return np.maximum(rows / np.iinfo(rows.dtype).max, -1.0)
