"""CAPOD, the canonically posed 3D objects data set (Papadakis 2014): 15 classes of 12 objects."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.datasets.scene import Scene, existing_folder, found, safe_name
from puckbench.io.meshes import read_mesh_report

CREDIT = (
    'P. Papadakis, "The Canonically Posed 3D Objects Dataset", '
    "Eurographics Workshop on 3D Object Retrieval, 2014"
)
LICENCE = "CC-BY 3.0"


@dataclass(frozen=True)
class Capod:
    """The objects of a CAPOD folder: ``CAPOD.cla`` and ``class<k>/m<N>.obj``.

    path: the folder. classes: names of classes to keep (Human, ..., Car); all by default.
    Scenes are called m001 to m180 and grouped by class. The objects have no unit: one is taken
    for a metre.
    """

    path: str
    classes: tuple[str, ...] | None = None

    def names(self) -> list[str]:
        """m001, m002, ...; InputError tells which object files are missing."""
        return list(self._table)

    def files(self, name: str) -> list[Path]:
        """The object file."""
        return [found(self._table, name, self.path)[0]]

    def load(self, name: str) -> Scene:
        """Read the object; `about` tells what the reader found and skipped."""
        path, group = found(self._table, name, self.path)
        mesh, report = read_mesh_report(path, up="z")
        about = {"source": f"CAPOD {path.name}", "licence": LICENCE, "credit": CREDIT, **report}
        return Scene(name, group, mesh=mesh, about=about)

    @cached_property
    def _table(self) -> dict[str, tuple[Path, str]]:
        folder = existing_folder(self.path, "CAPOD")
        classes = _read_classes(folder / "CAPOD.cla")
        unknown = sorted(set(self.classes or ()) - set(classes))
        if unknown:
            raise InputError(f"CAPOD has no class '{unknown[0]}' (known: {', '.join(classes)})")
        table = {
            f"m{number:03d}": (folder / f"class{index}" / f"m{number}.obj", safe_name(name))
            for index, (name, numbers) in enumerate(classes.items(), start=1)
            for number in numbers
            if self.classes is None or name in self.classes
        }
        _check_complete(folder, table)
        return dict(sorted(table.items()))


def _read_classes(path: Path) -> dict[str, list[int]]:
    """Class names with their objects' numbers, from a Princeton shape benchmark ``.cla`` file."""
    tokens = read_bytes(path).decode("latin-1").split()
    try:
        said, rest = (int(tokens[2]), int(tokens[3])), iter(tokens[4:])
        classes = {}
        for name in rest:
            next(rest)  # the parent class, always 0
            classes[name] = [int(next(rest)) for _ in range(int(next(rest)))]
    except (IndexError, ValueError, StopIteration, RuntimeError) as error:
        raise InputError(f"{path}: not a readable classification (.cla) file") from error
    held = (len(classes), sum(map(len, classes.values())))
    if tokens[:2] != ["PSB", "1"] or held != said:
        raise InputError(f"{path}: says {said} classes and objects, but lists {held}")
    return classes


def _check_complete(folder: Path, table: dict[str, tuple[Path, str]]) -> None:
    missing = [path.relative_to(folder) for path, _ in table.values() if not path.is_file()]
    if missing:
        raise InputError(
            f"{folder}: CAPOD is incomplete: {len(missing)} of {len(table)} objects are missing, "
            f"the first is {missing[0]}"
        )
