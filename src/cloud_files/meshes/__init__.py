"""Readers of meshes (GLB, OBJ, OFF, PLY, STL), and a writer of labelled PLY files."""

from cloud_files.meshes.ply import write_mesh
from cloud_files.meshes.reading import SUFFIXES, read_mesh, read_mesh_report, warn_of_skipped

__all__ = ["SUFFIXES", "read_mesh", "read_mesh_report", "warn_of_skipped", "write_mesh"]
