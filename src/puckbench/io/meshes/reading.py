"""Reading a mesh of any supported format into triangles in metres with z up."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.content import plain_suffix, unpacked
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh, check_mesh
from puckbench.io.meshes.glb import read_glb
from puckbench.io.meshes.obj import read_obj
from puckbench.io.meshes.off import read_off
from puckbench.io.meshes.ply import read_ply
from puckbench.io.meshes.polygons import Polygons, select_triangles, triangulate
from puckbench.io.meshes.stl import read_stl

_LOG = logging.getLogger(__name__)
_READERS: dict[str, Callable[[Path], Polygons]] = {
    ".glb": read_glb,
    ".obj": read_obj,
    ".off": read_off,
    ".ply": read_ply,
    ".stl": read_stl,
}
SUFFIXES = tuple(_READERS)


def read_mesh(path: Path, up: str = "z") -> Mesh:
    """Read a mesh file, turned to z up; `up` is the file's axis where the format does not say.

    Raises InputError, one line that names the file, when it is missing, damaged, empty, has no
    faces, no face with an area, or a face without finite vertices.
    """
    mesh, report = read_mesh_report(path, up)
    remark_skipped(path, report["skipped"])
    return mesh


def remark_skipped(path: Path, skipped: Mapping[str, int]) -> None:
    """Say in one line what a reader left out of a mesh file."""
    if skipped:
        parts = (f"{count} {name.replace('_', ' ')}" for name, count in skipped.items())
        _LOG.warning("%s: left out: %s", path, ", ".join(parts))


def read_mesh_report(path: Path, up: str = "z") -> tuple[Mesh, dict[str, Any]]:
    """Like `read_mesh`, with counts of what the file held and of what was left out.

    The report has ``format``, ``faces``, ``polygons`` (faces of more than three corners),
    ``triangles`` (of the mesh returned), ``zero_area`` (triangles without area, left out of
    unlabelled meshes) and ``skipped``, which names what else the reader left out.
    """
    if up not in ("y", "z"):
        raise InputError(f"up: {up!r} is not an axis that can point up (allowed: y, z)")
    read = _reader(path)
    # Numbers that are not finite, or whose squares are not, are for the check of the whole mesh.
    with unpacked(path) as plain, np.errstate(invalid="ignore", over="ignore"):
        polygons = read(plain)
        turned = _turned(polygons, polygons.up or up)
        return mesh_of_polygons(turned, str(path), plain_suffix(path)[1:])


def mesh_of_polygons(polygons: Polygons, what: str, kind: str) -> tuple[Mesh, dict[str, Any]]:
    """Triangulate and check what a reader found; the report is that of `read_mesh_report`.

    `what` names the source in errors, `kind` its format in the report.
    """
    mesh, _ = triangulate(polygons, what)
    check_mesh(mesh, what)
    if not np.isfinite(mesh.vertices).all():  # of faces that were left out
        mesh = _with_used_vertices(mesh)
    flat = _without_area(mesh)
    kept = mesh if mesh.labels or not flat.any() else select_triangles(mesh, ~flat)
    short = int(np.count_nonzero(polygons.sizes < 3))
    skipped = {**polygons.skipped, "faces_of_one_or_two_corners": short}
    return kept, {
        "format": kind,
        "faces": len(polygons.sizes),
        "polygons": int(np.count_nonzero(polygons.sizes > 3)),
        "triangles": len(kept.triangles),
        "zero_area": int(np.count_nonzero(flat)),
        "skipped": {name: count for name, count in skipped.items() if count},
    }


def _with_used_vertices(mesh: Mesh) -> Mesh:
    """The mesh without vertices that no triangle has."""
    used, triangles = np.unique(mesh.triangles, return_inverse=True)
    return Mesh(mesh.vertices[used], triangles.reshape(-1, 3), mesh.labels)


def _without_area(mesh: Mesh) -> NDArray[np.bool_]:
    """Where the area is zero, or nothing but rounding against the longest edge, (t,)."""
    corners = mesh.corners()
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return np.asarray(mesh.areas() <= 1e-12 * longest**2)


def y_up_to_z_up(points: Floats) -> Floats:
    """Turn points (n, 3) by 90 degrees about x, so that the y axis becomes the z axis."""
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


def _reader(path: Path) -> Callable[[Path], Polygons]:
    reader = _READERS.get(plain_suffix(path))
    if reader is None:
        raise InputError(f"{path}: not a mesh format (known: {', '.join(SUFFIXES)})")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    return reader


def _turned(polygons: Polygons, up: str) -> Polygons:
    if up == "z":
        return polygons
    return replace(polygons, vertices=y_up_to_z_up(polygons.vertices))
