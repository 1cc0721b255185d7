"""S3DIS, Stanford's large-scale indoor scenes (Armeni 2016): rooms as coloured clouds."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.scene_sets.base import Count, FolderSet, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name
from puckbench.scene_sets.xyzrgb import read_xyzrgb

CODE = ("puckbench.scene_sets.xyzrgb",)

_ROOMS = {"Area_1": 44, "Area_2": 40, "Area_3": 23, "Area_4": 49, "Area_5": 68, "Area_6": 48}
_NUMBER = re.compile(r"_\d+$")


@LOADERS.register("s3dis")
class S3DIS(FolderSet):
    """The scenes are S3DIS's rooms in text files ``Area_<n>/<room>/<room>.txt``.

    They are named Area_1_office_1 and grouped by room type (office).
    """

    of_clouds: ClassVar[bool] = True
    licence = "terms of Stanford's S3DIS, not redistributable"
    credit = 'I. Armeni et al., "3D Semantic Parsing of Large-Scale Indoor Spaces", CVPR 2016'
    expected = "expected S3DIS, with Area_1, ..., Area_6"

    areas: tuple[str, ...] | None = None
    """Names of areas to keep (Area_1, ...); all by default."""

    def files(self, name: str) -> list[Path]:
        return [_room_file(self.file_of(name))]

    def load(self, name: str) -> Scene:
        folder = self.file_of(name)
        path, area = _room_file(folder), folder.parent.name
        text = read_xyzrgb(path)
        about = self.about(
            f"S3DIS {area}/{folder.name}",
            aligned=(folder.parent / f"{area}_alignmentAngle.txt").exists(),
            repaired_lines={path.name: text.repaired} if text.repaired else {},
            dropped_lines={path.name: text.dropped} if text.dropped else {},
        )
        if path.stem != folder.name:
            about["misnamed"] = path.name
        cloud = PointCloud(text.xyz, colours=text.colours, about=about)
        box = np.stack([cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)])
        return Scene(name, room_type(folder.name), cloud=cloud, box=box, about=about)

    def counts(self) -> list[Count]:
        areas = [room.parent.name for room in self._whole()._table.values()]
        return [Count(area, areas.count(area), rooms) for area, rooms in _ROOMS.items()]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        areas = {path.name: path for path in sorted(folder.glob("Area_*")) if path.is_dir()}
        if not areas:
            raise self.missing("Area_<n> folders")
        kept = sorted(select_names("areas", self.areas, list(areas)))
        rooms = [room for area in kept for room in areas[area].iterdir() if _is_room(room)]
        if not rooms:
            raise InputError(f"{self.path}: no rooms in {', '.join(kept)}")
        return dict(sorted((safe_name(f"{p.parent.name}_{p.name}"), p) for p in rooms))


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
