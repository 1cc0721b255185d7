"""Models of the Stanford 3D Scanning Repository (bunny, dragon, ...), as PLY files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from cloud_files.meshes import read_mesh_report
from pointkit.geometry.mesh import Mesh
from puckbench.scene_sets.base import MeshFolderSet, select_names
from puckbench.scene_sets.registry import LOADERS

_CREDIT = "Stanford Computer Graphics Laboratory, The Stanford 3D Scanning Repository"
_CREDIT_XYZRGB = f"{_CREDIT}; scanned by XYZ RGB Inc."


class _ScannedModel(NamedTuple):
    """A model's file, up axis, metres per unit, and number of faces in the published file."""

    file: str
    up: str
    unit: float
    triangles: int | None = None


# The faces of the files; the repository's page gives 1,132,830 for the dragon and 7,218,906 for the
# Asian dragon.
_MODELS = {
    "armadillo": _ScannedModel("Armadillo.ply", "y", 0.001, 345_944),
    "asian_dragon": _ScannedModel("xyzrgb_dragon.ply", "y", 0.001, 7_219_045),
    "bunny": _ScannedModel("bun_zipper.ply", "y", 1.0, 69_451),
    "dragon": _ScannedModel("dragon_vrip.ply", "y", 1.0, 871_414),
    "drill": _ScannedModel("drill_shaft_vrip.ply", "y", 1.0),
    "happy_buddha": _ScannedModel("happy_vrip.ply", "y", 1.0, 1_087_716),
    "lucy": _ScannedModel("lucy.ply", "z", 0.001, 28_055_742),
    "thai_statue": _ScannedModel("xyzrgb_statuette.ply", "y", 0.001, 10_000_000),
    "vellum_manuscript": _ScannedModel("xyzrgb_manuscript.ply", "z", 0.001),
}
_BY_FILE = {model.file: model for model in _MODELS.values()}


@LOADERS.register("stanford_scans")
class StanfordScans(MeshFolderSet):
    """The scenes are scanned models in PLY files, anywhere below a folder.

    All are in the group "scan". Reduced versions (``bun_zipper_res2.ply``) and range scans are
    ignored.
    """

    licence = "research use with credit, not commercial; see the repository's page"
    credit = _CREDIT
    expected = (
        "expected models of the Stanford 3D Scanning Repository, such as bun_zipper.ply; available "
        "at graphics.stanford.edu/data/3Dscanrep"
    )

    models: tuple[str, ...] | None = None
    """Names of models to keep (bunny, dragon, ...); all by default."""

    def listed(self, folder: Path) -> Mapping[str, Path]:
        paths_by_file = {path.name: path for path in sorted(folder.rglob("*.ply"), reverse=True)}
        present = [name for name, model in _MODELS.items() if model.file in paths_by_file]
        if not present:
            raise self.missing("known models")
        kept = sorted(select_names("models", self.models, present))
        return {name: paths_by_file[_MODELS[name].file] for name in kept}

    def group_of(self, path: Path) -> str:
        return "scan"

    def source_of(self, path: Path) -> str:
        return f"Stanford 3D Scanning Repository {path.name}"

    def read_mesh(self, path: Path) -> tuple[Mesh, dict[str, Any]]:
        model = _BY_FILE[path.name]
        mesh, report = read_mesh_report(path, up=model.up)
        credit = _CREDIT_XYZRGB if path.name.startswith("xyzrgb") else _CREDIT
        details = {"metres_per_unit": model.unit, "faces_expected": model.triangles}
        scaled = Mesh(mesh.vertices * model.unit, mesh.triangles)
        return scaled, {"credit": credit, **details, **report}
