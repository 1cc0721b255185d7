"""The models of the Stanford 3D Scanning Repository: bunny, dragon and the others, as PLY."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.datasets.embedded import chosen
from puckbench.datasets.scene import Scene, existing_folder, found
from puckbench.geometry.mesh import Mesh
from puckbench.io.meshes import read_mesh_report

_CREDIT = "Stanford Computer Graphics Laboratory, The Stanford 3D Scanning Repository"
_CREDIT_XYZRGB = f"{_CREDIT}; scanned by XYZ RGB Inc."
_LICENCE = "research use with credit, not commercial; see the repository's page"
_ASK = (
    "models of the Stanford 3D Scanning Repository should lie there, such as bun_zipper.ply; "
    "Stanford gives them at graphics.stanford.edu/data/3Dscanrep"
)


@dataclass(frozen=True)
class _Model:
    """A model's file at full resolution, its up axis, its unit in metres and its faces where known.

    The repository names no unit: the models of the first years are in metres, the later ones have
    the size of the thing in millimetres.
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


@dataclass(frozen=True)
class StanfordScans:
    """Models by the names of their files, anywhere below a folder; those that are there.

    path: the folder. models: names to keep (bunny, dragon, ...); all by default. They are one
    group, "scan". Reduced versions (``bun_zipper_res2.ply``) and range scans are passed over.
    """

    path: str
    models: tuple[str, ...] | None = None

    def names(self) -> list[str]:
        """The models that are there."""
        return sorted(chosen("models", self.models, list(self._table)))

    def files(self, name: str) -> list[Path]:
        """The model's file."""
        return [found(self._table, name, self.path)]

    def load(self, name: str) -> Scene:
        """Read the model; `about` has the faces that the file should have, and those found."""
        path = found(self._table, name, self.path)
        model = _MODELS[name]
        mesh, report = read_mesh_report(path, up=model.up)
        about = {
            "source": f"Stanford 3D Scanning Repository {path.name}",
            "licence": _LICENCE,
            "credit": _CREDIT_XYZRGB if path.name.startswith("xyzrgb") else _CREDIT,
            "metres_per_unit": model.unit,
            "faces_expected": model.triangles,
            **report,
        }
        scaled = Mesh(mesh.vertices * model.unit, mesh.triangles)
        return Scene(name, "scan", mesh=scaled, about=about)

    @cached_property
    def _table(self) -> dict[str, Path]:
        folder = existing_folder(self.path, _ASK)
        there = {path.name: path for path in sorted(folder.rglob("*.ply"), reverse=True)}
        table = {name: there[model.file] for name, model in _MODELS.items() if model.file in there}
        if not table:
            raise InputError(f"{self.path}: none of its models there ({_ASK})")
        return table
