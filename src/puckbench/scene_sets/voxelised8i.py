"""8i's voxelised bodies (d'Eon 2017): people as coloured clouds on an integer grid."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import PositiveFloat, PositiveInt

from cloud_files.clouds import read_cloud
from cloud_files.meshes.reading import y_up_to_z_up
from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.scene_sets.base import Count, FolderSet, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, unique_names

_FRAME = re.compile(r"(?P<sequence>\w+?)_vox(?P<bits>\d+)(?:_(?P<frame>\d+))?", re.ASCII)
_SCALE = re.compile(rb"^comment frame_to_world_scale (\d*\.?\d+)\s*$", re.MULTILINE)
_HEADER_BYTES = 4096
_HEIGHT_M = 1.8
_FRAMES = 300
_SEQUENCES = ("longdress", "loot", "redandblack", "soldier")


@LOADERS.register("voxelised8i")
class Voxelised8i(FolderSet):
    """The scenes are coloured clouds in files ``<sequence>_vox<bits>_<frame>.ply`` below a folder.

    They are named after their files and grouped by sequence. Y up is rotated to z up. Coordinates
    that are not integers on the grid raise InputError.
    """

    of_clouds: ClassVar[bool] = True
    licence = "8i's licence agreement: MPEG, JPEG and research that is not commercial"
    credit = (
        'E. d\'Eon, B. Harrison, T. Myers, P. A. Chou, "8i Voxelized Full Bodies", '
        "ISO/IEC JTC1/SC29 WG11 M40059 / WG1 M74006, Geneva, 2017"
    )
    expected = (
        "expected 8iVFB v2, with longdress/Ply/longdress_vox10_1051.ply, ...; available from JPEG "
        "Pleno under 8i's licence, jpeg.org/plenodb"
    )

    sequences: tuple[str, ...] | None = None
    """Names of sequences to keep (longdress, ...); all by default."""
    every: PositiveInt = 1
    """Use every n-th frame."""
    height_m: PositiveFloat | None = None
    """Length of the grid's side, m. By default, a voxel's side is ``frame_to_world_scale`` of the
    file's header, in cm (about 0.18), or else 1.8 m (a person's height) divided by the grid's
    number of voxels per side."""

    def load(self, name: str) -> Scene:
        path = self.file_of(name)
        frame = _FRAME.match(name)
        bits = int(frame["bits"]) if frame else 0
        cloud = read_cloud(path, keep_missing=True)
        _check_grid(cloud.xyz, bits, path)
        _, first = np.unique(cloud.xyz, axis=0, return_index=True)
        voxels = cloud.select(np.sort(first))
        step = self._metres_per_voxel(path, bits)
        about = self.about(
            f"8i {path.name}",
            bits=bits,
            metres_per_voxel=step,
            # Y up became z up: what was z from 0 runs along y from below to 0.
            grid={"metres": step, "origin": [0.0, (1 - 2**bits) * step, 0.0], "size": 2**bits},
            double_voxels=len(cloud) - len(first),
        )
        normals = None if voxels.normals is None else y_up_to_z_up(voxels.normals)
        xyz = y_up_to_z_up(voxels.xyz) * step
        turned = PointCloud(xyz, normals, voxels.colours, about=about)
        return Scene(name, _sequence(name), cloud=turned, about=about)

    def counts(self) -> list[Count]:
        sequences = [_sequence(name) for name in self._whole().names()]
        return [Count(sequence, sequences.count(sequence), _FRAMES) for sequence in _SEQUENCES]

    def _metres_per_voxel(self, path: Path, bits: int) -> float:
        scale = _SCALE.search(read_bytes(path)[:_HEADER_BYTES])
        if self.height_m is None and scale is not None:
            return float(scale[1]) / 100
        return (self.height_m or _HEIGHT_M) / float(2**bits)

    def listed(self, folder: Path) -> Mapping[str, Path]:
        paths = sorted(p for p in folder.rglob("*_vox*.ply") if _FRAME.fullmatch(p.stem))
        if not paths:
            raise self.missing("frames *_vox<bits>_<frame>.ply")
        names = unique_names(path.stem for path in paths)
        frames = dict(sorted(zip(names, paths, strict=True)))
        available = sorted(set(map(_sequence, frames)))
        kept = [
            name
            for sequence in select_names("sequences", self.sequences, available)
            for name in [name for name in frames if _sequence(name) == sequence][:: self.every]
        ]
        return {name: frames[name] for name in kept}


def _sequence(name: str) -> str:
    match = _FRAME.match(name)
    return match["sequence"] if match else name


def _check_grid(points: Floats, bits: int, path: Path) -> None:
    inside = (points == np.rint(points)) & (points >= 0) & (points < 2**bits)
    if off := int(np.count_nonzero(~inside.all(axis=1))):
        fault = f"{off} of {len(points)} points are not on the grid of {bits} bits"
        raise InputError(f"{path}: {fault}")
