"""S3DIS, Stanford's large-scale indoor scenes (Armeni 2016): rooms as coloured clouds."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from puckbench.core.errors import InputError
from puckbench.datasets.base import FolderSet, Provenance, select_names
from puckbench.datasets.published_counts import Count
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene, safe_name
from puckbench.datasets.xyzrgb import TextCloud, read_xyzrgb
from puckbench.geometry.cloud import PointCloud

CLASSES = (
    "ceiling", "floor", "wall", "beam", "column", "window", "door", "table", "chair", "sofa",
    "bookcase", "board", "clutter",
)  # fmt: skip
_ROOMS = {"Area_1": 44, "Area_2": 40, "Area_3": 23, "Area_4": 49, "Area_5": 68, "Area_6": 48}
_COPY = re.compile(r" \(\d+\)$")
_NUMBER = re.compile(r"_\d+$")
_EXPECTED = "expected S3DIS, with Area_1, ..., Area_6"


@LOADERS.register("s3dis")
class S3DIS(FolderSet):
    """Rooms in text files ``Area_<n>/<room>/<room>.txt``, with ``Annotations/*.txt``.

    Scenes are named Area_1_office_1 and grouped by room type (office).
    """

    of_clouds: ClassVar[bool] = True
    provenance = Provenance(
        "terms of Stanford's S3DIS, not redistributable",
        'I. Armeni et al., "3D Semantic Parsing of Large-Scale Indoor Spaces", CVPR 2016',
        _EXPECTED,
    )

    areas: tuple[str, ...] | None = None
    """Names of areas to keep (Area_1, ...); all by default."""
    labels: bool = False
    """Whether to take the points from the annotations, each with its class (an index into
    `CLASSES`); otherwise they come from the room's file, without labels."""

    def files(self, name: str) -> list[Path]:
        folder = self._file(name)
        return _annotations(folder)[0] if self.labels else [_room_file(folder)]

    def load(self, name: str) -> Scene:
        folder = self._file(name)
        cloud = self._labelled_cloud(folder) if self.labels else self._plain_cloud(folder)
        box = np.stack([cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)])
        return Scene(name, room_type(folder.name), cloud=cloud, box=box, about=cloud.about)

    def counts(self) -> list[Count]:
        areas = [room.parent.name for room in self._whole()._table.values()]
        return [Count(area, areas.count(area), rooms) for area, rooms in _ROOMS.items()]

    def _listed(self, folder: Path) -> Mapping[str, Path]:
        areas = {path.name: path for path in sorted(folder.glob("Area_*")) if path.is_dir()}
        if not areas:
            raise self._missing("Area_<n> folders")
        kept = sorted(select_names("areas", self.areas, list(areas)))
        rooms = [room for area in kept for room in areas[area].iterdir() if _is_room(room)]
        if not rooms:
            raise InputError(f"{self.path}: no rooms in {', '.join(kept)}")
        return dict(sorted((safe_name(f"{p.parent.name}_{p.name}"), p) for p in rooms))

    def _plain_cloud(self, folder: Path) -> PointCloud:
        path = _room_file(folder)
        text = read_xyzrgb(path)
        about = self._about_room(folder, {path: text})
        if path.stem != folder.name:
            about["misnamed"] = path.name
        return PointCloud(text.xyz, colours=text.colours, about=about)

    def _labelled_cloud(self, folder: Path) -> PointCloud:
        paths, copies = _annotations(folder)
        texts = {path: read_xyzrgb(path) for path in paths}
        classes = [_NUMBER.sub("", _COPY.sub("", path.stem)) for path in paths]
        about = self._about_room(folder, texts)
        about["classes"] = list(CLASSES)
        about["copies_left_out"] = [path.name for path in copies]
        about["read_as_clutter"] = sorted(set(classes) - set(CLASSES))
        labels = np.array([_label(name) for name in classes], dtype=np.int32)
        return PointCloud(
            np.concatenate([text.xyz for text in texts.values()]),
            colours=np.concatenate([text.colours for text in texts.values()]),
            labels=np.repeat(labels, [len(text.xyz) for text in texts.values()]),
            about=about,
        )

    def _about_room(self, folder: Path, texts: Mapping[Path, TextCloud]) -> dict[str, Any]:
        area = folder.parent.name
        return self._about(
            f"S3DIS {area}/{folder.name}",
            aligned=(folder.parent / f"{area}_alignmentAngle.txt").exists(),
            repaired_lines={p.name: text.repaired for p, text in texts.items() if text.repaired},
            dropped_lines={p.name: text.dropped for p, text in texts.items() if text.dropped},
        )


def room_type(room: str) -> str:
    return _NUMBER.sub("", room)


def _is_room(folder: Path) -> bool:
    return not folder.name.startswith(".") and folder.is_dir() and any(_texts(folder))


def _texts(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.txt") if not path.name.startswith("."))


def _room_file(folder: Path) -> Path:
    """Return a room's point file, or the only text file if it is misnamed (Area_6/copyRoom_1)."""
    named, texts = folder / f"{folder.name}.txt", _texts(folder)
    if named in texts:
        return named
    if len(texts) != 1:
        raise InputError(f"{folder}: no {named.name}, but {len(texts)} other text files")
    return texts[0]


def _annotations(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the annotation files, and duplicates to ignore, such as "wall_3 (1).txt"."""
    texts = _texts(folder / "Annotations")
    names = {path.stem for path in texts}
    copies = [p for p in texts if _COPY.search(p.stem) and _COPY.sub("", p.stem) in names]
    kept = [path for path in texts if path not in copies]
    if not kept:
        raise InputError(f"{folder / 'Annotations'}: no annotations")
    return kept, copies


def _label(name: str) -> int:
    return CLASSES.index(name if name in CLASSES else "clutter")
