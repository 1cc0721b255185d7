"""The models of the Stanford 3D Scanning Repository: bunny, dragon and the others, as PLY."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from puckbench.datasets.base import MeshFolderSet, Provenance, chosen
from puckbench.datasets.registry import LOADERS
from puckbench.geometry.mesh import Mesh
from puckbench.io.meshes import read_mesh_report

_CREDIT = "Stanford Computer Graphics Laboratory, The Stanford 3D Scanning Repository"
_CREDIT_XYZRGB = f"{_CREDIT}; scanned by XYZ RGB Inc."
_EXPECTED = (
    "models of the Stanford 3D Scanning Repository should lie there, such as bun_zipper.ply; "
    "Stanford gives them at graphics.stanford.edu/data/3Dscanrep"
)


@dataclass(frozen=True)
class _Model:
    """A model's file at full resolution, its up axis, its unit in metres and its faces where known.

    The repository names no unit: the models of the first years are in metres, the later ones have
    the size of the original in millimetres.
    """

    file: str
    up: str
    unit: float
    triangles: int | None = None


# The faces of the files; the repository's page gives 1,132,830 for the dragon and 7,218,906 for the
# Asian dragon.
_MODELS = {
    "armadillo": _Model("Armadillo.ply", "y", 0.001, 345_944),
    "asian_dragon": _Model("xyzrgb_dragon.ply", "y", 0.001, 7_219_045),
    "bunny": _Model("bun_zipper.ply", "y", 1.0, 69_451),
    "dragon": _Model("dragon_vrip.ply", "y", 1.0, 871_414),
    "drill": _Model("drill_shaft_vrip.ply", "y", 1.0),
    "happy_buddha": _Model("happy_vrip.ply", "y", 1.0, 1_087_716),
    "lucy": _Model("lucy.ply", "z", 0.001, 28_055_742),
    "thai_statue": _Model("xyzrgb_statuette.ply", "y", 0.001, 10_000_000),
    "vellum_manuscript": _Model("xyzrgb_manuscript.ply", "z", 0.001),
}
_BY_FILE = {model.file: model for model in _MODELS.values()}


@LOADERS.register("stanford_scans")
class StanfordScans(MeshFolderSet):
    """Models by the names of their files, anywhere below a folder; those that are there.

    They are one group, "scan". Reduced versions (``bun_zipper_res2.ply``) and range scans are
    passed over.
    """

    provenance = Provenance(
        "research use with credit, not commercial; see the repository's page", _CREDIT, _EXPECTED
    )

    models: tuple[str, ...] | None = None
    """Names of models to keep (bunny, dragon, ...); all by default."""

    def _listed(self, folder: Path) -> Mapping[str, Path]:
        there = {path.name: path for path in sorted(folder.rglob("*.ply"), reverse=True)}
        table = {name: there[model.file] for name, model in _MODELS.items() if model.file in there}
        if not table:
            raise self._missing("such models")
        return {name: table[name] for name in sorted(chosen("models", self.models, list(table)))}

    def _group(self, path: Path) -> str:
        return "scan"

    def _source(self, path: Path) -> str:
        return f"Stanford 3D Scanning Repository {path.name}"

    def _read(self, path: Path) -> tuple[Mesh, dict[str, Any]]:
        """The scaled mesh, with the number of faces that its file should have."""
        model = _BY_FILE[path.name]
        mesh, report = read_mesh_report(path, up=model.up)
        credit = _CREDIT_XYZRGB if path.name.startswith("xyzrgb") else _CREDIT
        details = {"metres_per_unit": model.unit, "faces_expected": model.triangles}
        return Mesh(mesh.vertices * model.unit, mesh.triangles), {
            "credit": credit,
            **details,
            **report,
        }
