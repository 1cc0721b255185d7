"""Any folder of meshes as a set of scenes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.datasets.scene import Scene, existing_folder, found, safe_name, unique_names
from puckbench.geometry.mesh import Mesh
from puckbench.io.clouds import sidecar
from puckbench.io.meshes import SUFFIXES, read_mesh_report


@dataclass(frozen=True)
class MeshFolder:
    """The OBJ, OFF, PLY, STL and GLB files of a folder; a sub-folder is a group.

    path: the folder. recursive: whether to look into sub-folders. up: the axis ("y" or "z") that
    points up, where the format does not say. metres_per_unit: length of the files' unit.
    licence, credit: noted with every scene.
    """

    path: str
    recursive: bool = True
    up: str = "z"
    metres_per_unit: float = 1.0
    licence: str = ""
    credit: str = ""

    def __post_init__(self) -> None:
        if self.up not in ("y", "z"):
            raise InputError(f"up: '{self.up}' is not allowed (allowed: y, z)")
        if self.metres_per_unit <= 0:
            raise InputError(f"metres_per_unit: {self.metres_per_unit} is not above 0")

    def names(self) -> list[str]:
        """File names without suffix, after those of their sub-folders."""
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        """The mesh file and, for a PLY of our own, the JSON beside it."""
        path = self._path(name)
        beside = [sidecar(path)] if path.suffix.lower() == ".ply" else []
        return [path, *(extra for extra in beside if extra.exists())]

    def load(self, name: str) -> Scene:
        """Read the mesh; `about` tells what the reader found and skipped."""
        path = self._path(name)
        mesh, report = read_mesh_report(path, self.up)
        scaled = Mesh(mesh.vertices * self.metres_per_unit, mesh.triangles, mesh.labels)
        about = {"source": path.name, "licence": self.licence, "credit": self.credit, **report}
        return Scene(name, self._group(path), mesh=scaled, about=about)

    def _path(self, name: str) -> Path:
        return found(self._table, name, self.path)

    def _group(self, path: Path) -> str:
        inside = path.relative_to(self.path).parts
        return safe_name(inside[0] if len(inside) > 1 else Path(self.path).name)

    @cached_property
    def _table(self) -> dict[str, Path]:
        folder = existing_folder(self.path, "a folder of meshes")
        every = folder.rglob("*") if self.recursive else folder.glob("*")
        paths = sorted(path for path in every if _is_mesh(path))
        if not paths:
            raise InputError(f"{self.path}: no mesh files there ({', '.join(SUFFIXES)})")
        inside = ["-".join(path.relative_to(folder).with_suffix("").parts) for path in paths]
        return dict(zip(unique_names(inside), paths, strict=True))


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file()
