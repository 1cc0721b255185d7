"""S3DIS, Stanford's 3D indoor scenes (Armeni 2016): rooms as coloured clouds, with their damage."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.datasets.counts import Count
from puckbench.datasets.scene import Scene, existing_folder, found, safe_name
from puckbench.datasets.xyzrgb import TextCloud, read_xyzrgb
from puckbench.geometry.cloud import PointCloud

CLASSES = (
    "ceiling",
    "floor",
    "wall",
    "beam",
    "column",
    "window",
    "door",
    "table",
    "chair",
    "sofa",
    "bookcase",
    "board",
    "clutter",
)
_ROOMS = {"Area_1": 44, "Area_2": 40, "Area_3": 23, "Area_4": 49, "Area_5": 68, "Area_6": 48}
_COPY = re.compile(r" \(\d+\)$")
_NUMBER = re.compile(r"_\d+$")
_LICENCE = "terms of Stanford's S3DIS, not redistributable"
_CREDIT = 'I. Armeni et al., "3D Semantic Parsing of Large-Scale Indoor Spaces", CVPR 2016'


@dataclass(frozen=True)
class S3DIS:
    """Rooms in the layout of S3DIS: ``Area_<n>/<room>/<room>.txt`` and ``Annotations/*.txt``.

    path: the folder that holds the areas. areas: names of areas to keep (Area_1, ...); all by
    default. labels: take the points from the annotations, each with its class (an index into
    `CLASSES`); otherwise they come from the room's file, without labels. Scenes are called
    Area_1_office_1 and grouped by room type (office).
    """

    path: str
    areas: tuple[str, ...] | None = None
    labels: bool = False

    def names(self) -> list[str]:
        """Area and room of every room."""
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        """The room's file, or with labels those of its annotations."""
        folder = found(self._table, name, self.path)
        return _annotations(folder)[0] if self.labels else [_room_file(folder)]

    def load(self, name: str) -> Scene:
        """Read the room; `about` tells which lines were repaired or dropped and why."""
        folder = found(self._table, name, self.path)
        cloud = _labelled_cloud(folder) if self.labels else _plain_cloud(folder)
        box = np.stack([cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)])
        group = _NUMBER.sub("", folder.name)
        return Scene(name, group, cloud=cloud, box=box, about=cloud.about)

    def counts(self) -> list[Count]:
        """Rooms of each area; 272 in all."""
        areas = [room.parent.name for room in replace(self, areas=None)._table.values()]
        return [Count(area, areas.count(area), rooms) for area, rooms in _ROOMS.items()]

    @cached_property
    def _table(self) -> dict[str, Path]:
        root = existing_folder(self.path, "S3DIS's areas")
        areas = {path.name: path for path in sorted(root.glob("Area_*")) if path.is_dir()}
        if not areas:
            raise InputError(f"{self.path}: no Area_<n> folders there (S3DIS should lie there)")
        missing = sorted(set(self.areas or ()) - set(areas))
        if missing:
            raise InputError(f"{self.path}: no area '{missing[0]}' (it has {', '.join(areas)})")
        kept = [path for name, path in areas.items() if not self.areas or name in self.areas]
        rooms = [room for area in kept for room in area.iterdir() if _is_room(room)]
        if not rooms:
            raise InputError(f"{self.path}: no rooms in {', '.join(path.name for path in kept)}")
        return {safe_name(f"{room.parent.name}_{room.name}"): room for room in rooms}


def _is_room(folder: Path) -> bool:
    return not folder.name.startswith(".") and folder.is_dir() and any(_texts(folder))


def _texts(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.txt") if not path.name.startswith("."))


def _room_file(folder: Path) -> Path:
    """The room's own file; the only text there when it is misnamed (Area_6/copyRoom_1)."""
    named, texts = folder / f"{folder.name}.txt", _texts(folder)
    if named in texts:
        return named
    if len(texts) != 1:
        raise InputError(f"{folder}: no {named.name} there, but {len(texts)} other texts")
    return texts[0]


def _annotations(folder: Path) -> tuple[list[Path], list[Path]]:
    """Annotation files to read, and copies ("wall_3 (1).txt") to leave out."""
    texts = _texts(folder / "Annotations")
    names = {path.stem for path in texts}
    copies = [p for p in texts if _COPY.search(p.stem) and _COPY.sub("", p.stem) in names]
    kept = [path for path in texts if path not in copies]
    if not kept:
        raise InputError(f"{folder / 'Annotations'}: no annotations there")
    return kept, copies


def _plain_cloud(folder: Path) -> PointCloud:
    path = _room_file(folder)
    text = read_xyzrgb(path)
    about = _about(folder, [(path, text)])
    if path.stem != folder.name:
        about["misnamed"] = path.name
    return PointCloud(text.xyz, colours=text.colours, about=about)


def _labelled_cloud(folder: Path) -> PointCloud:
    paths, copies = _annotations(folder)
    texts = [read_xyzrgb(path) for path in paths]
    classes = [_NUMBER.sub("", _COPY.sub("", path.stem)) for path in paths]
    labels = [_label(name) for name in classes]
    sizes = [len(text.xyz) for text in texts]
    about = _about(folder, zip(paths, texts, strict=True))
    about["classes"] = list(CLASSES)
    about["copies_left_out"] = [path.name for path in copies]
    about["read_as_clutter"] = sorted(set(classes) - set(CLASSES))
    return PointCloud(
        np.concatenate([text.xyz for text in texts]),
        colours=np.concatenate([text.colours for text in texts]),
        labels=np.repeat(np.array(labels, dtype=np.int32), sizes),
        about=about,
    )


def _label(name: str) -> int:
    return CLASSES.index(name if name in CLASSES else "clutter")


def _about(folder: Path, texts: Iterable[tuple[Path, TextCloud]]) -> dict[str, Any]:
    """Licence, release and the lines that were repaired or dropped, by file."""
    texts = list(texts)
    area = folder.parent.name
    return {
        "source": f"S3DIS {area}/{folder.name}",
        "licence": _LICENCE,
        "credit": _CREDIT,
        "aligned": (folder.parent / f"{area}_alignmentAngle.txt").exists(),
        "repaired_lines": {path.name: text.repaired for path, text in texts if text.repaired},
        "dropped_lines": {path.name: text.dropped for path, text in texts if text.dropped},
    }
