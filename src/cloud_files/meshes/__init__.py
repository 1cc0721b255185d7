from cloud_files.meshes.reading import SUFFIXES, read_mesh, read_mesh_report, warn_of_skipped
from cloud_files.meshes.writing import write_mesh

__all__ = ["SUFFIXES", "read_mesh", "read_mesh_report", "warn_of_skipped", "write_mesh"]
