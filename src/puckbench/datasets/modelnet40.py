"""ModelNet40 (Wu 2015): 12,311 CAD models of 40 classes, as OFF files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable
from puckbench.datasets.counts import Count
from puckbench.datasets.embedded import chosen
from puckbench.datasets.scene import Scene, existing_folder, found, safe_name, unique_names
from puckbench.io.meshes import read_mesh_report

SPLITS = ("train", "test")

_PUBLISHED = {"train": 9843, "test": 2468}
_LICENCE = "for academic use; the models belong to their authors"
_CREDIT = 'Z. Wu et al., "3D ShapeNets: A Deep Representation for Volumetric Shapes", CVPR 2015'
_ASK = (
    "ModelNet40 should lie there, with airplane/train, ..., xbox/test in it; Princeton gives it "
    "for academic use, modelnet.cs.princeton.edu"
)


@dataclass(frozen=True)
class ModelNet40:
    """The models of a ModelNet folder: ``<class>/{train,test}/<class>_0001.off``.

    path: the folder that holds the classes. classes: names of classes to keep (airplane, ...,
    xbox); all by default. split: "train" or "test"; both by default. Scenes are called
    chair_0001 and grouped by class. The models have no unit: one is taken for a metre. Z is up.
    """

    path: str
    classes: tuple[str, ...] | None = None
    split: str | None = None

    def __post_init__(self) -> None:
        if self.split not in (None, *SPLITS):
            raise InputError(f"split: '{self.split}' is not allowed (allowed: train, test)")

    def names(self) -> list[str]:
        """Class and number of every model; lists folders, reads no file."""
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        """The model's file."""
        return [found(self._table, name, self.path)]

    def load(self, name: str) -> Scene:
        """Read the model; `about` tells whether its header was glued to its counts."""
        path = found(self._table, name, self.path)
        mesh, report = read_mesh_report(path, up="z")
        about = {
            "source": f"ModelNet40 {path.parent.name}/{path.name}",
            "licence": _LICENCE,
            "credit": _CREDIT,
            "header_glued": _is_glued(path),
            **report,
        }
        return Scene(name, safe_name(path.parent.parent.name), mesh=mesh, about=about)

    def counts(self) -> list[Count]:
        """Classes, and models of each split."""
        every = list(replace(self, classes=None, split=None)._table.values())
        held = {split: sum(path.parent.name == split for path in every) for split in SPLITS}
        classes = Count("classes", len({path.parent.parent for path in every}), 40)
        return [classes, *(Count(split, held[split], _PUBLISHED[split]) for split in SPLITS)]

    @cached_property
    def _table(self) -> dict[str, Path]:
        folder = existing_folder(self.path, _ASK)
        classes = sorted(
            {path.parent.name for split in SPLITS for path in folder.glob(f"*/{split}")}
        )
        if not classes:
            raise InputError(f"{self.path}: no <class>/train or <class>/test there ({_ASK})")
        splits = SPLITS if self.split is None else (self.split,)
        folders = [
            folder / name / split
            for name in sorted(chosen("classes", self.classes, classes))
            for split in splits
        ]
        paths = [path for place in folders for path in sorted(place.glob("*.off"))]
        models = [path for path in paths if not path.name.startswith(".")]
        if not models:
            raise InputError(f"{self.path}: no models (.off) in {', '.join(splits)}")
        return dict(zip(unique_names(path.stem for path in models), models, strict=True))


def _is_glued(path: Path) -> bool:
    """Whether the file starts as in ``OFF3514 3546 0``."""
    try:
        with path.open("rb") as stream:
            return stream.read(4)[3:].isdigit()
    except OSError as error:
        raise unreadable(path, error) from error
