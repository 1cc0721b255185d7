"""Mesh files of all formats, as triangle meshes."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.content import plain_suffix, unpacked
from cloud_files.meshes.ply import read_ply
from cloud_files.meshes.polygons import Polygons, select_triangles, triangulate
from pointkit.errors import InputError
from pointkit.files import refuse_special
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh, check_mesh
from pointkit.lazy import imported

_LOG = logging.getLogger(__name__)
READERS = {
    ".glb": "cloud_files.meshes.glb:read_glb",
    ".obj": "cloud_files.meshes.obj:read_obj",
    ".off": "cloud_files.meshes.off:read_off",
    ".stl": "cloud_files.meshes.stl:read_stl",
}
"""Readers of formats other than PLY, by suffix."""
SUFFIXES = tuple(sorted((".ply", *READERS)))
"""Suffixes of readable mesh files; compressed files have a second suffix."""


def read_mesh(path: str | Path, up: str = "z") -> Mesh:
    """Read a mesh from a file, as triangles with z up.

    Elements that are not read (such as lines and curves) are counted in a warning.

    Parameters
    ----------
    path
        A file whose suffix is in `SUFFIXES`, which may be compressed (``.gz``, ``.bz2``, ``.xz`` or
        ``.zst`` after the suffix).
    up
        Axis of the file that points up, "y" or "z". It is ignored for GLB files, in which y is
        always up.

    Returns
    -------
    Mesh
        Vertices (v, 3) in the file's order and unit (GLB: metres), and triangles (t, 3). Triangles
        without area are left out, unless the mesh has labels.

    Raises
    ------
    InputError
        The file is missing, damaged or larger than its limits, or the mesh is empty, without area
        or not finite. The message is one line that begins with the file's name.
    """
    mesh, report = read_mesh_report(path, up)
    warn_of_skipped(Path(path), report["skipped"])
    return mesh


def warn_of_skipped(path: Path, skipped: Mapping[str, int]) -> None:
    """Log a warning if a reader left out elements of a file.

    Parameters
    ----------
    path
        The file.
    skipped
        Numbers of elements that were left out, by name.
    """
    if skipped:
        parts = (f"{count} {name.replace('_', ' ')}" for name, count in skipped.items())
        _LOG.warning("%s: left out: %s", path, ", ".join(parts))


def read_mesh_report(path: str | Path, up: str = "z") -> tuple[Mesh, dict[str, Any]]:
    """Read a mesh as `read_mesh` does, but return a report on the file in place of warnings.

    Returns
    -------
    tuple of Mesh and dict
        The mesh, and a report: ``format`` (the suffix without its point), ``faces`` (number of
        faces in the file), ``polygons`` (faces of more than three corners), ``triangles``
        (triangles of the returned mesh), ``zero_area`` (triangles without area) and ``skipped``
        (number of elements that were left out, by name).
    """
    if up not in ("y", "z"):
        raise InputError(f"up: {up!r} is not an axis that can point up (allowed: y, z)")
    path = Path(path)
    read = _reader(path)
    with unpacked(path) as plain, np.errstate(invalid="ignore", over="ignore"):
        polygons = read(plain)
        if (polygons.up or up) == "y":
            polygons = replace(polygons, vertices=y_up_to_z_up(polygons.vertices))
        return mesh_from_polygons(polygons, str(path), plain_suffix(path)[1:])


def mesh_from_polygons(polygons: Polygons, source: str, kind: str) -> tuple[Mesh, dict[str, Any]]:
    """Triangulate and check the polygons that a reader returned.

    Parameters
    ----------
    polygons
        The polygons.
    source
        Name of the file for messages.
    kind
        Format of the file for the report.

    Returns
    -------
    tuple of Mesh and dict
        The mesh and the report, as from `read_mesh_report`.

    Raises
    ------
    InputError
        The mesh is empty, without area or not finite.
    """
    mesh, _ = triangulate(polygons, source)
    check_mesh(mesh, source)
    if not np.isfinite(mesh.vertices).all():  # vertices without a triangle
        mesh = _without_unused_vertices(mesh)
    flat = _has_no_area(mesh)
    result = mesh if mesh.labels or not flat.any() else select_triangles(mesh, ~flat)
    short = int(np.count_nonzero(polygons.sizes < 3))
    skipped = {**polygons.skipped, "faces_of_one_or_two_corners": short}
    return result, {
        "format": kind,
        "faces": len(polygons.sizes),
        "polygons": int(np.count_nonzero(polygons.sizes > 3)),
        "triangles": len(result.triangles),
        "zero_area": int(np.count_nonzero(flat)),
        "skipped": {name: count for name, count in skipped.items() if count},
    }


def _without_unused_vertices(mesh: Mesh) -> Mesh:
    used, triangles = np.unique(mesh.triangles, return_inverse=True)
    return Mesh(mesh.vertices[used], triangles.reshape(-1, 3), mesh.labels)


def _has_no_area(mesh: Mesh) -> NDArray[np.bool_]:
    corners = mesh.corners()
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return np.asarray(mesh.areas() <= 1e-12 * longest**2)


def y_up_to_z_up(points: Floats) -> Floats:
    """Return points (n, 3) rotated by 90 degrees about x, so that y becomes z and z becomes -y."""
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


def _reader(path: Path) -> Callable[[Path], Polygons]:
    suffix = plain_suffix(path)
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: not a mesh format (known: {', '.join(SUFFIXES)})")
    refuse_special(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    return imported(READERS[suffix]) if suffix in READERS else read_ply
