from __future__ import annotations

from pathlib import Path

from puckbench.core.content import plain_suffix
from puckbench.core.errors import InputError
from puckbench.datasets.captured_rooms import read_capture
from puckbench.geometry.cloud import PointCloud
from puckbench.geometry.mesh import Mesh, scaled_mesh
from puckbench.io.clouds import SUFFIXES, read_cloud
from puckbench.io.meshes import read_mesh
from puckbench.io.ply import has_faces


def read_surface(path: Path, metres_per_unit: float = 1.0) -> Mesh:
    """Read a mesh file or captured room (.json) in metres."""
    mesh = read_capture(path).mesh if path.suffix == ".json" else read_mesh(path)
    if mesh is None:
        raise InputError(f"{path}: has no mesh")
    return scaled_mesh(mesh, metres_per_unit)


def read_truth(path: Path) -> Mesh | PointCloud:
    """Read a true surface: a mesh, or a cloud (such as a PLY file without faces)."""
    suffix = plain_suffix(path)
    if suffix in SUFFIXES and not (suffix == ".ply" and has_faces(path)):
        return read_cloud(path)
    return read_surface(path)
