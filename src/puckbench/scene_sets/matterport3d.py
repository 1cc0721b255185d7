"""Matterport3D (Chang 2017): 90 buildings as meshes, made from panoramic depth images."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

from puckbench.scene_sets.base import Count, MeshFolderSet, existing_folder, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import safe_name

_BUILDINGS = 90


@LOADERS.register("matterport3d")
class Matterport3D(MeshFolderSet):
    """The scenes are rooms (regions) in ``<building>/region_segmentations/region<k>.ply``.

    They are in metres with z up. The folder is ``v1/scans``; unpacked archives may repeat the
    folder with the building's name. Scenes are named <building>_region0 and grouped by building.
    """

    licence = "Matterport3D's terms of use: academic, not redistributable"
    credit = (
        'A. Chang et al., "Matterport3D: Learning from RGB-D Data in Indoor Environments", 2017'
    )
    expected = (
        "expected Matterport3D, unpacked, with <building>/region_segmentations/region0.ply, ...; "
        "available from its authors after a signed agreement, "
        "niessner.github.io/Matterport"
    )

    buildings: tuple[str, ...] | None = None
    """Names of buildings to keep; all by default."""

    def counts(self) -> list[Count]:
        return [Count("buildings", len(self._regions), _BUILDINGS)]

    @cached_property
    def _regions(self) -> dict[str, dict[str, Path]]:
        root = existing_folder(self.path, self.expected)
        regions: dict[str, dict[str, Path]] = {}
        for layout in ("*", "*/*"):
            for path in sorted(root.glob(f"{layout}/region_segmentations/region*.ply")):
                regions.setdefault(self._building(path), {}).setdefault(path.stem, path)
        if not regions:
            raise self.missing("region_segmentations/region<k>.ply")
        return dict(sorted(regions.items()))

    def listed(self, folder: Path) -> Mapping[str, Path]:
        table = {
            safe_name(f"{building}_{region}"): path
            for building in select_names("buildings", self.buildings, list(self._regions))
            for region, path in self._regions[building].items()
        }
        return dict(sorted(table.items()))

    def _building(self, path: Path) -> str:
        return path.relative_to(self.path).parts[0]

    def group_of(self, path: Path) -> str:
        return safe_name(self._building(path))

    def source_of(self, path: Path) -> str:
        return f"Matterport3D {self._building(path)}/{path.name}"
