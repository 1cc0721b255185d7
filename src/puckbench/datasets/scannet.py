"""ScanNet (Dai 2017): 1,513 rooms as meshes from a depth camera."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.datasets.counts import Count
from puckbench.datasets.scene import Scene, existing_folder, found, safe_name
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.io.meshes import read_mesh_report

_SCAN = re.compile(r"scene\d{4}_\d{2}")
_LICENCE = "ScanNet's terms of use, not redistributable"
_CREDIT = (
    'A. Dai et al., "ScanNet: Richly-annotated 3D Reconstructions of Indoor Scenes", CVPR 2017'
)
_ASK = (
    "ScanNet's scans should lie there, with scene0000_00/scene0000_00_vh_clean_2.ply and so on in "
    "it; its authors give them after a signed agreement, www.scan-net.org"
)
_PUBLISHED = 1513


@dataclass(frozen=True)
class ScanNet:
    """Rooms as ``scene0000_00/scene0000_00_vh_clean_2.ply``, in metres, z up.

    path: the folder of the scans (its sub-folder ``scans`` will do). full: read the meshes of full
    resolution, ``..._vh_clean.ply``. aligned: turn the room by ``axisAlignment`` of its ``.txt``,
    which brings walls along the axes. Scenes are named as their scans and grouped by the
    ``sceneType`` of the ``.txt``, "unknown" where there is none (the hidden test has none).
    """

    path: str
    full: bool = False
    aligned: bool = True

    def names(self) -> list[str]:
        """Names of the scans whose mesh is there."""
        return list(self._table)

    def files(self, name: str) -> list[Path]:
        """The mesh and, where there is one, the description of the scan."""
        mesh = found(self._table, name, self.path)
        described = _description_file(mesh)
        return [mesh, described] if described.is_file() else [mesh]

    def load(self, name: str) -> Scene:
        """Read the mesh; `about` tells whether it was aligned and what the reader skipped."""
        path = found(self._table, name, self.path)
        described = _description(_description_file(path))
        mesh, report = read_mesh_report(path, up="z")
        pose = _alignment(described, _description_file(path)) if self.aligned else None
        if pose is not None:
            mesh = Mesh(mesh.vertices @ pose[:3, :3].T + pose[:3, 3], mesh.triangles)
        about = {
            "source": f"ScanNet {path.name}",
            "licence": _LICENCE,
            "credit": _CREDIT,
            "aligned": pose is not None,
            **report,
        }
        group = safe_name(described.get("sceneType", "unknown")).lower()
        return Scene(name, group, mesh=mesh, about=about)

    def counts(self) -> list[Count]:
        """Scans of the public part."""
        return [Count("scans", len(self.names()), _PUBLISHED)]

    @cached_property
    def _table(self) -> dict[str, Path]:
        root = existing_folder(self.path, _ASK)
        folder = root / "scans" if (root / "scans").is_dir() else root
        scans = sorted(path.name for path in folder.iterdir() if _SCAN.fullmatch(path.name))
        end = "_vh_clean.ply" if self.full else "_vh_clean_2.ply"
        meshes = {name: folder / name / f"{name}{end}" for name in scans}
        table = {name: path for name, path in meshes.items() if path.is_file()}
        if not table:
            raise InputError(f"{self.path}: no scene<n>_<k>/...{end} there ({_ASK})")
        return table


def _description_file(mesh: Path) -> Path:
    return mesh.parent / f"{mesh.parent.name}.txt"


def _description(path: Path) -> dict[str, str]:
    """Lines ``key = value`` of a scan's text; none where there is no text."""
    if not path.is_file():
        return {}
    lines = read_bytes(path).decode("latin-1").splitlines()
    pairs = (line.partition("=") for line in lines)
    return {key.strip(): value.strip() for key, _, value in pairs}


def _alignment(described: dict[str, str], path: Path) -> Floats | None:
    """The 4x4 matrix ``axisAlignment``, row by row; None where the text has none."""
    if "axisAlignment" not in described:
        return None
    try:
        pose = np.array([float(number) for number in described["axisAlignment"].split()])
        return pose.reshape(4, 4)
    except ValueError as error:
        raise InputError(f"{path}: axisAlignment is not a matrix of 16 numbers") from error
