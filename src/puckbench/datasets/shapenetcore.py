"""ShapeNetCore (Chang 2015), versions 1 and 2: about 51,300 CAD models of 55 classes, as OBJ."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import yaml

from puckbench.core.errors import InputError
from puckbench.datasets.counts import Count
from puckbench.datasets.embedded import chosen
from puckbench.datasets.scene import Scene, existing_folder, found
from puckbench.io.meshes import read_mesh_report

_SYNSET = re.compile(r"\d{8}")
_FILES = ("models/model_normalized.obj", "model.obj")  # version 2, version 1
_CLASSES = 55
# Converted without vertices in the first release of version 1 (ShapeNet/shapenet-viewer, issue 7).
_EMPTY = {
    "03624134/67ada28ebc79cc75a056f196c127ed77",
    "04090263/4a32519f44dc84aabafe26e2eb69ebf4",
}
_LICENCE = "ShapeNet's terms of use: research and education, not redistributable"
_CREDIT = 'A. X. Chang et al., "ShapeNet: An Information-Rich 3D Model Repository", 2015'
_ASK = (
    "ShapeNetCore, version 1 or 2, should lie there, with 02691156, ..., 04554684 in it; ShapeNet "
    "gives it under its own terms after registration at shapenet.org"
)


@dataclass(frozen=True)
class ShapeNetCore:
    """Models as ``<synset>/<id>/model.obj`` or ``<synset>/<id>/models/model_normalized.obj``.

    path: the folder that holds the synsets. classes: names of classes (airplane, ..., washer)
    to keep; all by default. Scenes are called chair_<id> and grouped by class. The models are
    normalised, without a unit: one is taken for a metre. Y is up, and turned to z. Models whose
    file is missing, as some of the releases are, are left out.
    """

    path: str
    classes: tuple[str, ...] | None = None

    def names(self) -> list[str]:
        """Class and id of every model; lists folders, reads no model."""
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        """The model's OBJ file; materials have no extent."""
        return [found(self._table, name, self.path)[0]]

    def load(self, name: str) -> Scene:
        """Read the model; `about` tells what the reader found and skipped."""
        path, group = found(self._table, name, self.path)
        mesh, report = read_mesh_report(path, up="y")
        version = 2 if path.name == "model_normalized.obj" else 1
        about = {
            "source": f"ShapeNetCore.v{version} {path.relative_to(self.path)}",
            "licence": _LICENCE,
            "credit": _CREDIT,
            **report,
        }
        return Scene(name, group, mesh=mesh, about=about)

    def counts(self) -> list[Count]:
        """Classes; of models only the rough number is published."""
        every = replace(self, classes=None)._table
        return [Count("classes", len({group for _, group in every.values()}), _CLASSES)]

    @cached_property
    def _table(self) -> dict[str, tuple[Path, str]]:
        root = existing_folder(self.path, _ASK)
        synsets = {_class_of(path): path for path in sorted(root.iterdir()) if _is_synset(path)}
        if not synsets:
            raise InputError(f"{self.path}: no synsets such as 02691156 there ({_ASK})")
        table = {
            f"{group}_{model.name}": (path, group)
            for group in chosen("classes", self.classes, list(synsets))
            for model in synsets[group].iterdir()
            if (path := _model_file(model)) is not None
        }
        if not table:
            raise InputError(f"{self.path}: no model.obj and no model_normalized.obj ({_ASK})")
        return table


@cache
def _synsets() -> dict[str, str]:
    with Path(__file__).with_name("shapenet_synsets.yaml").open(encoding="utf-8") as stream:
        return dict(yaml.safe_load(stream))


def _is_synset(path: Path) -> bool:
    return _SYNSET.fullmatch(path.name) is not None and path.is_dir()


def _class_of(path: Path) -> str:
    return _synsets().get(path.name, path.name)


def _model_file(folder: Path) -> Path | None:
    """The model of a folder of either version; None where the release has none."""
    if f"{folder.parent.name}/{folder.name}" in _EMPTY:
        return None
    return next((folder / name for name in _FILES if (folder / name).is_file()), None)
