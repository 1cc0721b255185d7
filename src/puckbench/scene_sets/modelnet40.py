"""ModelNet40 (Wu 2015): 12,311 CAD models of 40 classes, as OFF files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pointkit.errors import InputError
from puckbench.scene_sets.base import Count, MeshFolderSet, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import safe_name, unique_names

_PUBLISHED = {"train": 9843, "test": 2468}
_CLASSES = 40


@LOADERS.register("modelnet40")
class ModelNet40(MeshFolderSet):
    """The scenes are CAD models in files ``<class>/{train,test}/<class>_0001.off``.

    They are named chair_0001 and grouped by class. The unit is assumed to be 1 m. Z is up.
    """

    licence = "for academic use; the models belong to their authors"
    credit = 'Z. Wu et al., "3D ShapeNets: A Deep Representation for Volumetric Shapes", CVPR 2015'
    expected = (
        "expected ModelNet40, with airplane/train, ..., xbox/test; available for academic use, "
        "modelnet.cs.princeton.edu"
    )

    classes: tuple[str, ...] | None = None
    """Names of classes to keep (airplane, ..., xbox); all by default."""
    split: Literal["train", "test"] | None = None
    """The split to keep; both by default."""

    def counts(self) -> list[Count]:
        paths = self._whole()._table.values()
        splits = [path.parent.name for path in paths]
        classes = Count("classes", len({path.parent.parent for path in paths}), _CLASSES)
        models = [Count(name, splits.count(name), number) for name, number in _PUBLISHED.items()]
        return [classes, *models]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        parents = (path.parent for split in _PUBLISHED for path in folder.glob(f"*/{split}"))
        classes = sorted({path.name for path in parents})
        if not classes:
            raise self.missing("<class>/train or <class>/test")
        splits = list(_PUBLISHED) if self.split is None else [self.split]
        models = [
            path
            for name in sorted(select_names("classes", self.classes, classes))
            for split in splits
            for path in sorted((folder / name / split).glob("*.off"))
            if not path.name.startswith(".")
        ]
        if not models:
            raise InputError(f"{self.path}: no models (.off) in {', '.join(splits)}")
        return dict(sorted(zip(unique_names(path.stem for path in models), models, strict=True)))

    def group_of(self, path: Path) -> str:
        return safe_name(path.parent.parent.name)

    def source_of(self, path: Path) -> str:
        return f"ModelNet40 {path.parent.name}/{path.name}"
