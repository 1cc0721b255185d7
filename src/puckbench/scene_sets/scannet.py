"""ScanNet (Dai 2017): 1,513 scans of rooms as meshes, made with a depth camera."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from puckbench.scene_sets.base import Count, MeshFolderSet
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import safe_name

_SCAN = re.compile(r"scene\d{4}_\d{2}")
_PUBLISHED = 1513


@LOADERS.register("scannet")
class ScanNet(MeshFolderSet):
    """The scenes are rooms in files ``scene0000_00/scene0000_00_vh_clean_2.ply``.

    They are in metres with z up. Rooms' folders are in the folder `path`, or in the subfolder
    ``scans``. Scenes are named scene0000_00. They are grouped by ``sceneType`` in scene0000_00.txt
    or, without it, as "unknown".
    """

    licence = "ScanNet's terms of use, not redistributable"
    credit = (
        'A. Dai et al., "ScanNet: Richly-annotated 3D Reconstructions of Indoor Scenes", CVPR 2017'
    )
    expected = (
        "expected ScanNet's scans, with scene0000_00/scene0000_00_vh_clean_2.ply, ...; available "
        "from its authors after a signed agreement, www.scan-net.org"
    )

    full: bool = False
    """Whether to read the meshes of full resolution, ``..._vh_clean.ply``."""
    aligned: bool = True
    """Whether to rotate walls to the axes, by ``axisAlignment`` in the room's ``.txt``."""

    def files(self, name: str) -> list[Path]:
        mesh = self.file_of(name)
        description = _description_file(mesh)
        return [mesh, description] if description.is_file() else [mesh]

    def counts(self) -> list[Count]:
        return [Count("scans", len(self.names()), _PUBLISHED)]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        root = folder / "scans" if (folder / "scans").is_dir() else folder
        scans = sorted(path.name for path in root.iterdir() if _SCAN.fullmatch(path.name))
        end = "_vh_clean.ply" if self.full else "_vh_clean_2.ply"
        meshes = {name: root / name / f"{name}{end}" for name in scans}
        table = {name: path for name, path in meshes.items() if path.is_file()}
        if not table:
            raise self.missing(f"scene<n>_<k>/...{end}")
        return table

    def group_of(self, path: Path) -> str:
        return safe_name(_description(path).get("sceneType", "unknown")).lower()

    def source_of(self, path: Path) -> str:
        return f"ScanNet {path.name}"

    def read_mesh(self, path: Path) -> tuple[Mesh, dict[str, Any]]:
        mesh, report = super().read_mesh(path)
        pose = _alignment(path) if self.aligned else None
        if pose is not None:
            mesh = Mesh(mesh.vertices @ pose[:3, :3].T + pose[:3, 3], mesh.triangles)
        return mesh, {"aligned": pose is not None, **report}


def _description_file(mesh: Path) -> Path:
    return mesh.parent / f"{mesh.parent.name}.txt"


def _description(mesh: Path) -> dict[str, str]:
    path = _description_file(mesh)
    if not path.is_file():
        return {}
    lines = read_bytes(path).decode("latin-1").splitlines()
    pairs = (line.partition("=") for line in lines)
    return {key.strip(): value.strip() for key, _, value in pairs}


def _alignment(mesh: Path) -> Floats | None:
    description = _description(mesh)
    if "axisAlignment" not in description:
        return None
    try:
        pose = np.array([float(number) for number in description["axisAlignment"].split()])
        return pose.reshape(4, 4)
    except ValueError as error:
        what = f"{_description_file(mesh)}: axisAlignment is not a matrix of 16 numbers"
        raise InputError(what) from error
