from __future__ import annotations

from pathlib import Path

from cloud_files.clouds import SUFFIXES, read_cloud
from cloud_files.content import plain_suffix
from cloud_files.meshes import read_mesh
from cloud_files.ply import has_faces
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.lazy import imported

_CAPTURES = "puckbench.scene_sets.captured_rooms:read_capture"


def read_surface(path: Path) -> Mesh:
    """Return the mesh in a mesh file or in a captured room (``.json``), in the file's unit."""
    is_capture = path.suffix == ".json"
    mesh: Mesh | None = imported(_CAPTURES)(path).mesh if is_capture else read_mesh(path)
    if mesh is None:
        raise InputError(f"{path}: has no mesh")
    return mesh


def read_truth(path: Path) -> Mesh | PointCloud:
    """Return a true surface, which is a mesh or a cloud as the format of the file tells.

    A PLY file without faces is a cloud.
    """
    suffix = plain_suffix(path)
    if suffix in SUFFIXES and not (suffix == ".ply" and has_faces(path)):
        return read_cloud(path)
    return read_surface(path)
