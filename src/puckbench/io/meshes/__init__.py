"""Mesh files: the benchmark's own labelled PLY, and readers for OBJ, OFF, PLY, STL and GLB."""

from puckbench.io.meshes.reading import SUFFIXES, read_mesh, read_mesh_report, remark_skipped
from puckbench.io.meshes.writing import write_mesh

__all__ = ["SUFFIXES", "read_mesh", "read_mesh_report", "remark_skipped", "write_mesh"]
