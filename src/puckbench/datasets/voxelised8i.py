"""8i's voxelised bodies (d'Eon 2017): people as coloured clouds on an integer grid."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.datasets.counts import Count
from puckbench.datasets.embedded import chosen
from puckbench.datasets.scene import Scene, existing_folder, found, unique_names
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.io.clouds import read_cloud
from puckbench.io.meshes.reading import y_up_to_z_up

_FRAME = re.compile(r"(?P<sequence>\w+?)_vox(?P<bits>\d+)(?:_(?P<frame>\d+))?", re.ASCII)
_SCALE = re.compile(rb"^comment frame_to_world_scale (\d*\.?\d+)\s*$", re.MULTILINE)
_HEADER_BYTES = 4096
_HEIGHT_M = 1.8
_FRAMES = 300
_SEQUENCES = ("longdress", "loot", "redandblack", "soldier")
_LICENCE = "8i's licence agreement: MPEG, JPEG and research that is not commercial"
_CREDIT = (
    'E. d\'Eon, B. Harrison, T. Myers, P. A. Chou, "8i Voxelized Full Bodies", '
    "ISO/IEC JTC1/SC29 WG11 M40059 / WG1 M74006, Geneva, 2017"
)
_ASK = (
    "8iVFB v2 should lie there, with longdress/Ply/longdress_vox10_1051.ply and so on in it; JPEG "
    "Pleno gives it under 8i's licence, jpeg.org/plenodb"
)


@dataclass(frozen=True)
class Voxelised8i:
    """Frames ``<sequence>_vox<bits>_<frame>.ply`` anywhere below a folder.

    path: the folder. sequences: names of sequences to keep (longdress, ...); all by default.
    every: take one frame of so many. height_m: length of the grid's side; by default a voxel has
    the ``frame_to_world_scale`` of the file's header, taken for cm (it is about 0.18), or where
    there is none 1.8 m, a person's height, over the number of voxels. Scenes are named as their
    files and grouped by sequence. Colours are kept. Y is up, and turned to z. InputError for
    coordinates that are not on the grid.
    """

    path: str
    sequences: tuple[str, ...] | None = None
    every: int = 1
    height_m: float | None = None

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InputError(f"every: {self.every} is not at least 1")
        if self.height_m is not None and self.height_m <= 0:
            raise InputError(f"height_m: {self.height_m} is not above 0")

    def names(self) -> list[str]:
        """Names of the frames; lists folders, reads no file."""
        kept = chosen("sequences", self.sequences, sorted(set(map(_sequence, self._table))))
        return [
            name
            for sequence in kept
            for name in [name for name in self._table if _sequence(name) == sequence][:: self.every]
        ]

    def files(self, name: str) -> list[Path]:
        """The frame's file."""
        return [found(self._table, name, self.path)]

    def load(self, name: str) -> Scene:
        """Read the frame, in metres; `about` tells the grid and how many voxels stood twice."""
        path = found(self._table, name, self.path)
        bits = _bits(name)
        voxels, doubles = _distinct(_on_grid(read_cloud(path), bits, path))
        step = self._metres_per_voxel(path, bits)
        about: dict[str, Any] = {
            "source": f"8i {path.name}",
            "licence": _LICENCE,
            "credit": _CREDIT,
            "bits": bits,
            "metres_per_voxel": step,
            # Y up became z up: what was z from 0 runs along y from below to 0.
            "grid": {"metres": step, "origin": [0.0, (1 - 2**bits) * step, 0.0], "size": 2**bits},
            "double_voxels": doubles,
        }
        normals = None if voxels.normals is None else y_up_to_z_up(voxels.normals)
        xyz = y_up_to_z_up(voxels.xyz) * step
        cloud = PointCloud(xyz, normals, voxels.colours, about=about)
        return Scene(name, _sequence(name), cloud=cloud, about=about)

    def counts(self) -> list[Count]:
        """Frames of the four sequences of 8iVFB v2."""
        held = [_sequence(name) for name in replace(self, sequences=None, every=1).names()]
        return [Count(sequence, held.count(sequence), _FRAMES) for sequence in _SEQUENCES]

    def _metres_per_voxel(self, path: Path, bits: int) -> float:
        scale = _SCALE.search(read_bytes(path)[:_HEADER_BYTES])
        if self.height_m is None and scale is not None:
            return float(scale[1]) / 100
        side = _HEIGHT_M if self.height_m is None else self.height_m
        return side / float(2**bits)

    @cached_property
    def _table(self) -> dict[str, Path]:
        folder = existing_folder(self.path, _ASK)
        paths = sorted(p for p in folder.rglob("*_vox*.ply") if _FRAME.fullmatch(p.stem))
        if not paths:
            raise InputError(f"{self.path}: no frames *_vox<bits>_<frame>.ply there ({_ASK})")
        names = unique_names(path.stem for path in paths)
        return dict(sorted(zip(names, paths, strict=True)))


def _sequence(name: str) -> str:
    match = _FRAME.match(name)
    return match["sequence"] if match else name


def _bits(name: str) -> int:
    match = _FRAME.match(name)
    return int(match["bits"]) if match else 0


def _on_grid(cloud: PointCloud, bits: int, path: Path) -> PointCloud:
    """The cloud; InputError unless its coordinates are whole numbers from 0 to 2^bits - 1."""
    off = _off_grid(cloud.xyz, 2**bits - 1)
    if off:
        raise InputError(f"{path}: {off} of {len(cloud)} points are not on the grid of {bits} bits")
    return cloud


def _off_grid(points: Floats, highest: int) -> int:
    inside = (points == np.rint(points)) & (points >= 0) & (points <= highest)
    return int(np.count_nonzero(~inside.all(axis=1)))


def _distinct(cloud: PointCloud) -> tuple[PointCloud, int]:
    """The first point of every voxel, in the file's order, and how many others there were."""
    _, first = np.unique(cloud.xyz, axis=0, return_index=True)
    return cloud.select(np.sort(first)), len(cloud) - len(first)
