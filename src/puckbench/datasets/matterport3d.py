"""Matterport3D (Chang 2017): 90 buildings as meshes from panoramic depth cameras, by region."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.datasets.counts import Count
from puckbench.datasets.embedded import chosen
from puckbench.datasets.scene import Scene, existing_folder, found, safe_name
from puckbench.io.meshes import read_mesh_report

_LICENCE = "Matterport3D's terms of use: academic, not redistributable"
_CREDIT = 'A. Chang et al., "Matterport3D: Learning from RGB-D Data in Indoor Environments", 2017'
_ASK = (
    "Matterport3D should lie there, with <building>/region_segmentations/region0.ply and so on in "
    "it, its archives unpacked; its authors give it after a signed agreement, "
    "niessner.github.io/Matterport"
)
_BUILDINGS = 90


@dataclass(frozen=True)
class Matterport3D:
    """Regions (rooms) as ``<building>/region_segmentations/region<k>.ply``, in metres, z up.

    path: the folder that holds the buildings (``v1/scans``). buildings: names to keep; all by
    default. Scenes are called <building>_region0 and grouped by building. Archives that unpack
    into a second folder of the building's name are found as well.
    """

    path: str
    buildings: tuple[str, ...] | None = None

    def names(self) -> list[str]:
        """Building and region of every region."""
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        """The region's mesh."""
        return [found(self._table, name, self.path)[0]]

    def load(self, name: str) -> Scene:
        """Read the mesh; `about` tells what the reader found and skipped."""
        path, building = found(self._table, name, self.path)
        mesh, report = read_mesh_report(path, up="z")
        source = f"Matterport3D {building}/{path.name}"
        about = {"source": source, "licence": _LICENCE, "credit": _CREDIT, **report}
        return Scene(name, safe_name(building), mesh=mesh, about=about)

    def counts(self) -> list[Count]:
        """Buildings with any region."""
        return [Count("buildings", len(self._regions), _BUILDINGS)]

    @cached_property
    def _regions(self) -> dict[str, dict[str, Path]]:
        """Meshes of regions by building and name."""
        root = existing_folder(self.path, _ASK)
        regions: dict[str, dict[str, Path]] = {}
        for layout in ("*", "*/*"):
            for path in sorted(root.glob(f"{layout}/region_segmentations/region*.ply")):
                building = path.relative_to(root).parts[0]
                regions.setdefault(building, {}).setdefault(path.stem, path)
        if not regions:
            raise InputError(f"{self.path}: no region_segmentations/region<k>.ply there ({_ASK})")
        return dict(sorted(regions.items()))

    @cached_property
    def _table(self) -> dict[str, tuple[Path, str]]:
        return {
            safe_name(f"{building}_{region}"): (path, building)
            for building in chosen("buildings", self.buildings, list(self._regions))
            for region, path in self._regions[building].items()
        }
