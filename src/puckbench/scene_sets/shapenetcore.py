"""ShapeNetCore (Chang 2015), versions 1 and 2: about 51,300 CAD models of 55 classes, as OBJ."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cloud_files.meshes import read_mesh_report
from pointkit.geometry.mesh import Mesh
from pointkit.yaml_files import read_yaml
from puckbench.scene_sets.base import Count, MeshFolderSet, select_names
from puckbench.scene_sets.registry import LOADERS

_read_table = cache(read_yaml)
_SYNSET = re.compile(r"\d{8}")
_FILES = ("models/model_normalized.obj", "model.obj")  # version 2, version 1
_CLASSES = 55
# Converted without vertices in the first release of version 1 (ShapeNet/shapenet-viewer, issue 7).
_EMPTY = {"03624134/67ada28ebc79cc75a056f196c127ed77", "04090263/4a32519f44dc84aabafe26e2eb69ebf4"}


@LOADERS.register("shapenetcore")
class ShapeNetCore(MeshFolderSet):
    """The scenes are CAD models ``<synset>/<id>/model.obj`` or ``model_normalized.obj``.

    The file names are those of version 1 and version 2. Scenes are named chair_<id> and grouped by
    class. The models are normalised, and their unit is assumed to be 1 m. Y up is rotated to z up.
    Models without a file in the release are left out.
    """

    licence = "ShapeNet's terms of use: research and education, not redistributable"
    credit = 'A. X. Chang et al., "ShapeNet: An Information-Rich 3D Model Repository", 2015'
    expected = (
        "expected ShapeNetCore, version 1 or 2, with 02691156, ..., 04554684; available under "
        "ShapeNet's terms after registration at shapenet.org"
    )

    classes: tuple[str, ...] | None = None
    """Names of classes to keep (airplane, ..., washer); all by default."""

    def counts(self) -> list[Count]:
        groups = {self.group_of(path) for path in self._whole()._table.values()}
        return [Count("classes", len(groups), _CLASSES)]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        synsets = {_class_of(path): path for path in sorted(folder.iterdir()) if _is_synset(path)}
        if not synsets:
            raise self.missing("synsets such as 02691156")
        table = {
            f"{group}_{model.name}": path
            for group in select_names("classes", self.classes, list(synsets))
            for model in synsets[group].iterdir()
            if (path := _model_file(model)) is not None
        }
        if not table:
            raise self.missing("model.obj and no model_normalized.obj")
        return dict(sorted(table.items()))

    def group_of(self, path: Path) -> str:
        return _class_of(Path(path.relative_to(self.path).parts[0]))

    def source_of(self, path: Path) -> str:
        version = 2 if path.name == "model_normalized.obj" else 1
        return f"ShapeNetCore.v{version} {path.relative_to(self.path)}"

    def read_mesh(self, path: Path) -> tuple[Mesh, dict[str, Any]]:
        return read_mesh_report(path, up="y")


def _is_synset(path: Path) -> bool:
    return _SYNSET.fullmatch(path.name) is not None and path.is_dir()


def _class_of(synset: Path) -> str:
    names: dict[str, str] = _read_table(Path(__file__).with_suffix(".yaml"))
    return names.get(synset.name, synset.name)


def _model_file(folder: Path) -> Path | None:
    if f"{folder.parent.name}/{folder.name}" in _EMPTY:
        return None
    return next((folder / name for name in _FILES if (folder / name).is_file()), None)
