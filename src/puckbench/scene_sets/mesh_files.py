from __future__ import annotations

from pathlib import Path
from typing import Literal

from cloud_files.content import plain_suffix
from cloud_files.meshes import SUFFIXES, read_mesh_report, warn_of_skipped
from cloud_files.ply import has_faces
from pointkit.geometry.mesh import scaled_mesh
from puckbench.scene_sets.captured_rooms import is_captured_room, read_capture
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene
from puckbench.scene_sets.user_files import FileSet

CODE = ("puckbench.scene_sets.captured_rooms", "puckbench.scene_sets.user_files")


@LOADERS.register("mesh_files")
class MeshFiles(FileSet):
    """The scenes are the user's mesh files (OBJ, OFF, PLY, STL, GLB) and captured rooms (.json)."""

    suffixes = (*SUFFIXES, ".json")
    what = "meshes"

    up: Literal["y", "z"] = "z"
    """Up axis, if the file format does not define it."""

    def load(self, name: str) -> Scene:
        path = self.file_of(name)
        if path.suffix.lower() == ".json":
            return read_capture(path, name)
        mesh, report = read_mesh_report(path, self.up)
        warn_of_skipped(path, report["skipped"])
        about = {**self.about(path), **report}
        scaled = scaled_mesh(mesh, self.unit_of(path))
        return Scene(name, self.group_of(path), mesh=scaled, about=about)

    def takes(self, path: Path) -> bool:
        suffix = plain_suffix(path)
        if suffix == ".ply":
            return has_faces(path)
        return suffix != ".json" or is_captured_room(path)
