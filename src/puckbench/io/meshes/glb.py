"""Reading GLB (binary glTF) scenes as one mesh."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.io.meshes.polygons import Polygons, uniform

_DAMAGE = (
    AttributeError,
    IndexError,
    KeyError,
    NotImplementedError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)


def read_glb(path: Path) -> Polygons:
    """Read every mesh of a GLB file's scene, moved by its node; glTF is metres with y up.

    Geometries that have no faces (lines, points) are counted as skipped.
    """
    scene = _scene(path)
    meshes = [_placed(scene, node) for node in scene.graph.nodes_geometry]
    parts = [part for part in meshes if part is not None]
    if not parts:
        raise InputError(f"{path}: the mesh has no faces")
    counts = np.array([len(vertices) for vertices, _ in parts])
    shifts = np.cumsum(counts) - counts
    faces = np.concatenate([f + shift for (_, f), shift in zip(parts, shifts, strict=True)])
    joined = uniform(np.concatenate([vertices for vertices, _ in parts]), faces)
    skipped = {"geometries_without_faces": len(meshes) - len(parts)}
    return replace(joined, up="y", skipped=skipped)


def _scene(path: Path) -> Any:
    import trimesh

    data = read_bytes(path)
    if data[:4] != b"glTF" or len(data) < 12:
        raise InputError(f"{path}: not a GLB file")
    if len(data) < int.from_bytes(data[8:12], "little"):
        raise InputError(f"{path}: the GLB file is truncated")
    try:
        return trimesh.load_scene(str(path), process=False)
    except _DAMAGE as error:
        fault = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable GLB file ({fault})") from error


def _placed(scene: Any, node: str) -> tuple[Any, Any] | None:
    transform, name = scene.graph[node]
    geometry = scene.geometry[name]
    if not hasattr(geometry, "faces"):
        return None
    vertices = np.asarray(geometry.vertices, dtype=np.float64)
    moved = vertices @ transform[:3, :3].T + transform[:3, 3]
    return moved, np.asarray(geometry.faces, dtype=np.int64)
