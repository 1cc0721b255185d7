"""CAPOD, the canonically posed 3D objects data set (Papadakis 2014): 15 classes of 12 objects."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

from pointkit.errors import InputError
from pointkit.files import read_bytes
from puckbench.scene_sets.base import Count, MeshFolderSet, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import safe_name

_CLASSES, _OBJECTS = 15, 180


@LOADERS.register("capod")
class Capod(MeshFolderSet):
    """The scenes are CAPOD's objects in files ``class<k>/m<N>.obj``, listed in ``CAPOD.cla``.

    They are named m001 to m180 and grouped by class. The unit is assumed to be 1 m.
    """

    licence = "CC-BY 3.0"
    credit = (
        'P. Papadakis, "The Canonically Posed 3D Objects Dataset", '
        "Eurographics Workshop on 3D Object Retrieval, 2014"
    )
    expected = "expected CAPOD, with CAPOD.cla, class1, class2, ..."

    classes: tuple[str, ...] | None = None
    """Names of classes to keep (Human, ..., Car); all by default."""

    def files(self, name: str) -> list[Path]:
        return [self.file_of(name), self._classes_file]

    @property
    def _classes_file(self) -> Path:
        return Path(self.path) / "CAPOD.cla"

    @cached_property
    def _objects_of(self) -> dict[str, list[int]]:
        return _read_classes(self._classes_file)

    def listed(self, folder: Path) -> Mapping[str, Path]:
        kept = select_names("classes", self.classes, list(self._objects_of))
        table = {
            f"m{number:03d}": folder / f"class{index}" / f"m{number}.obj"
            for index, (name, numbers) in enumerate(self._objects_of.items(), start=1)
            for number in numbers
            if name in kept
        }
        _check_complete(folder, list(table.values()))
        return dict(sorted(table.items()))

    def counts(self) -> list[Count]:
        numbers = self._objects_of.values()
        return [
            Count("classes", len(self._objects_of), _CLASSES),
            Count("objects", sum(map(len, numbers)), _OBJECTS),
        ]

    def group_of(self, path: Path) -> str:
        index = int(path.parent.name.removeprefix("class"))
        return safe_name(list(self._objects_of)[index - 1])

    def source_of(self, path: Path) -> str:
        return f"CAPOD {path.name}"


def _read_classes(path: Path) -> dict[str, list[int]]:
    tokens = read_bytes(path).decode("latin-1").split()
    try:
        announced, remaining = (int(tokens[2]), int(tokens[3])), iter(tokens[4:])
        classes = {}
        for name in remaining:
            next(remaining)  # the parent class, always 0
            classes[name] = [int(next(remaining)) for _ in range(int(next(remaining)))]
    except (IndexError, ValueError, StopIteration, RuntimeError) as error:
        raise InputError(f"{path}: not a readable classification (.cla) file") from error
    listed = (len(classes), sum(map(len, classes.values())))
    if tokens[:2] != ["PSB", "1"] or listed != announced:
        raise InputError(f"{path}: announces {announced} classes and objects, but lists {listed}")
    return classes


def _check_complete(folder: Path, paths: list[Path]) -> None:
    missing = [path.relative_to(folder) for path in paths if not path.is_file()]
    if missing:
        fault = f"{len(missing)} of {len(paths)} objects are missing, such as {missing[0]}"
        raise InputError(f"{folder}: CAPOD is incomplete: {fault}")
