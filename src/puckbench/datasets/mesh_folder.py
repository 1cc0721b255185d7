from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from puckbench.core.errors import naming
from puckbench.datasets.base import MeshFolderSet, Provenance
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import safe_name, unique_names
from puckbench.datasets.units import Units, check_units, metres_per_unit_of
from puckbench.geometry.mesh import Mesh, scaled_mesh
from puckbench.io.descriptions import sidecar
from puckbench.io.meshes import SUFFIXES, read_mesh_report, warn_of_skipped


@LOADERS.register("mesh_folder")
class MeshFolder(MeshFolderSet):
    """Mesh files (OBJ, OFF, PLY, STL, GLB) of a folder, grouped by subfolder."""

    provenance = Provenance("", "", f"expected meshes: {', '.join(SUFFIXES)}")

    recursive: bool = True
    """Whether to look into sub-folders."""
    up: Literal["y", "z"] = "z"
    """Up axis, if the file format does not define it."""
    metres_per_unit: Units = 1.0
    """Length of the files' unit: a number, or a table of files and numbers (1 for the others)."""
    licence: str = ""
    """Licence noted with every scene."""
    credit: str = ""
    """Credit noted with every scene."""

    def files(self, name: str) -> list[Path]:
        path = self._file(name)
        beside = [sidecar(path)] if path.suffix.lower() == ".ply" else []
        return [path, *(extra for extra in beside if extra.exists())]

    def _listed(self, folder: Path) -> Mapping[str, Path]:
        paths_below = folder.rglob("*") if self.recursive else folder.glob("*")
        paths = sorted(path for path in paths_below if _is_mesh(path))
        if not paths:
            raise self._missing("mesh files")
        with naming("metres_per_unit"):
            check_units(self.metres_per_unit, paths)
        inside = ["-".join(path.relative_to(folder).with_suffix("").parts) for path in paths]
        return dict(sorted(zip(unique_names(inside), paths, strict=True)))

    def _read(self, path: Path) -> tuple[Mesh, dict[str, Any]]:
        mesh, report = read_mesh_report(path, self.up)
        warn_of_skipped(path, report["skipped"])
        scaled = scaled_mesh(mesh, metres_per_unit_of(path, self.metres_per_unit))
        return scaled, {"licence": self.licence, "credit": self.credit, **report}

    def _group(self, path: Path) -> str:
        inside = path.relative_to(self.path).parts
        return safe_name(inside[0] if len(inside) > 1 else Path(self.path).name)


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file()
