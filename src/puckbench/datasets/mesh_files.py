"""A user's own meshes, wherever their files lie."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

from puckbench.core.content import plain_suffix
from puckbench.datasets.captured_rooms import is_capture, read_capture
from puckbench.datasets.files import FileSet, announces_faces
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene
from puckbench.geometry.mesh import Mesh
from puckbench.io.meshes import SUFFIXES, read_mesh_report


@LOADERS.register("mesh_files")
class MeshFiles(FileSet):
    """Meshes in OBJ, OFF, PLY, STL and GLB files, and captured rooms (.json)."""

    of_clouds: ClassVar[bool] = False
    suffixes = (*SUFFIXES, ".json")
    what = "meshes"

    up: Literal["y", "z"] = "z"
    """The axis that points up, where the file format does not say."""

    def load(self, name: str) -> Scene:
        """Read the mesh, in metres with z up; `about` has what the reader found and skipped."""
        path = self._file(name)
        if path.suffix.lower() == ".json":
            return read_capture(path, name)
        mesh, report = read_mesh_report(path, self.up)
        scaled = Mesh(mesh.vertices * self.metres_per_unit, mesh.triangles, mesh.labels)
        about = {**self._about(path), **report}
        return Scene(name, self._group(path), mesh=scaled, about=about)

    def _takes(self, path: Path) -> bool:
        suffix = plain_suffix(path)
        if suffix == ".ply":
            return announces_faces(path)
        return suffix != ".json" or is_capture(path)
