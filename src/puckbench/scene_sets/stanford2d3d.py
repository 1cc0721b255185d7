"""2D-3D-S (Armeni 2017): meshes of S3DIS's buildings, split into areas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import NonNegativeFloat

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.scene_sets.area_mesh import AreaMesh, in_frame_of_s3dis, read_area_mesh
from puckbench.scene_sets.base import SceneSet, existing_folder, look_up, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.s3dis import S3DIS, room_type
from puckbench.scene_sets.scanner_positions import (
    camera_position,
    listed_file,
    listed_positions,
    pose_files,
)
from puckbench.scene_sets.scene import Scene

CODE = (
    *("puckbench.scene_sets.area_mesh", "puckbench.scene_sets.s3dis"),
    "puckbench.scene_sets.scanner_positions",
)

AREAS = ("area_1", "area_2", "area_3", "area_4", "area_5a", "area_5b", "area_6")

_LICENCE = "terms of Stanford's 2D-3D-S, not redistributable"
_CREDIT = (
    'I. Armeni, A. Sax et al., "Joint 2D-3D-Semantic Data for Indoor Scene Understanding", '
    "arXiv:1702.01105, 2017"
)
_EXPECTED_MESHES = (
    "expected 2D-3D-S, with area_1, ..., area_6; available under Stanford's licence by the form "
    "linked from the project alexsax/2D-3D-Semantics on GitHub"
)
_EXPECTED_CLOUDS = (
    "expected S3DIS, version 1.2, not the aligned one, with Area_1, ..., Area_6; available under "
    "Stanford's licence by the form of the S3DIS project, "
    "buildingparser.stanford.edu"
)
_EXPECTED_POSITIONS = (
    "expected the folder s3dis_locations of the thesis's repository branislavjenco/thesis-code on "
    "GitHub; without the option 'positions' the camera poses of 2D-3D-S are used"
)
# Less of a room's own triangles in its box, or a scanner farther from it, means that mesh and box
# have different frames.
_LEAST_SHARE = 0.5
_FARTHEST_M = 10.0


@dataclass(frozen=True)
class _Room:
    area: str
    room: str
    mesh: Path
    places: tuple[Path, ...]

    @property
    def in_s3dis(self) -> str:
        """Name of the room in S3DIS, where areas 5a and 5b are both Area_5."""
        return f"Area_{self.area[0]}_{self.room}"


@LOADERS.register("stanford2d3d")
class Stanford2D3D(SceneSet):
    """The scenes are rooms in meshes ``area_<n>/3d/semantic.obj``, each with a scanner position.

    They are named area_1_office_1 and grouped by room type. A room in both areas 5a and 5b is two
    scenes with one bounding box, as in the thesis.
    """

    path: str
    """Folder that holds the areas."""
    s3dis: str
    """Folder of S3DIS v1.2 (not aligned), from which the rooms' boxes are computed."""
    positions: str | None = None
    """Folder of ``locations_pruned<n>.json``, the thesis's scanner positions; by default, the
    camera position nearest to the centre of each room's box is used."""
    areas: tuple[str, ...] | None = None
    """Names of areas to use; by default all in the folder."""
    margin_m: NonNegativeFloat = 10.0
    """Distance around the room's box, in m, within which geometry is kept: scans see through doors.
    """

    def names(self) -> list[str]:
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        room = look_up(self._table, name, self.path)
        return [room.mesh, *self._clouds.files(room.in_s3dis), *room.places]

    def load(self, name: str) -> Scene:
        room = look_up(self._table, name, self.path)
        box = self._clouds.load(room.in_s3dis).box
        if box is None:
            raise ValueError(f"{room.in_s3dis} has no box")
        origin = self._origin(room, box)
        area = read_area_mesh(room.mesh, room.area)
        self._check_frame(name, room, area, box)
        mesh = area.near(box, self.margin_m)
        about = {
            "source": f"2D-3D-S area_{room.area}/{room.room}",
            "licence": _LICENCE,
            "credit": _CREDIT,
            "triangles": len(mesh.triangles),
            "triangles_of_area": len(area.mesh.triangles),
            "positions": "poses" if self.positions is None else "listed",
            "origin_in_box": _outside(origin, box) == 0,
        }
        x, y, z = origin.tolist()
        return Scene(name, room_type(room.room), mesh=mesh, origin=(x, y, z), box=box, about=about)

    def _origin(self, room: _Room, box: Floats) -> Floats:
        if self.positions is None:
            places = [camera_position(path) for path in room.places]
        else:
            places = [listed_positions(room.places[0], room.area)[room.room]]
        moved = in_frame_of_s3dis(np.array(places), room.area)
        nearest = moved[np.argmin(np.linalg.norm(moved - box.mean(axis=0), axis=1))]
        if _outside(nearest, box) > _FARTHEST_M:
            raise InputError(
                f"{room.places[0]}: the scanner would stand {_outside(nearest, box):.1f} m outside "
                f"the box of {room.in_s3dis} in {self.s3dis} (its version that is not aligned?)"
            )
        return np.asarray(nearest)

    def _check_frame(self, name: str, room: _Room, area: AreaMesh, box: Floats) -> None:
        share = area.share_inside(room.room, box)
        if share < _LEAST_SHARE:
            raise InputError(
                f"{room.mesh}: {share:.0%} of {name} lies in its box from {self.s3dis}, "
                f"at least {_LEAST_SHARE:.0%} should (S3DIS v1.2, not its aligned version?)"
            )

    @cached_property
    def _clouds(self) -> S3DIS:
        existing_folder(self.s3dis, _EXPECTED_CLOUDS)
        return S3DIS(path=self.s3dis)

    @cached_property
    def _table(self) -> dict[str, _Room]:
        rooms = [room for area in self._areas() for room in self._rooms(area)]
        scenes = set(self._clouds.names())
        missing = [room.in_s3dis for room in rooms if room.in_s3dis not in scenes]
        if missing:
            raise InputError(
                f"{self.s3dis}: {len(missing)} of {len(rooms)} rooms are missing, such as "
                f"{missing[0]} ({_EXPECTED_CLOUDS})"
            )
        return {f"area_{room.area}_{room.room}": room for room in rooms}

    def _areas(self) -> list[str]:
        root = existing_folder(self.path, _EXPECTED_MESHES)
        present = [name for name in AREAS if (root / name).is_dir()]
        kept = present if self.areas is None else select_names("areas", self.areas, list(AREAS))
        if not kept:
            raise InputError(f"{root}: no areas ({_EXPECTED_MESHES})")
        for name in kept:
            if not _mesh_file(root, name).is_file():
                raise InputError(f"{_mesh_file(root, name)}: no such file ({_EXPECTED_MESHES})")
        return [name.removeprefix("area_") for name in sorted(kept)]

    def _rooms(self, area: str) -> list[_Room]:
        folder = Path(self.path) / f"area_{area}"
        if self.positions is None:
            places = {room: tuple(files) for room, files in pose_files(folder).items()}
        else:
            listed = listed_file(Path(self.positions), area)
            if not listed.is_file():
                raise InputError(f"{listed}: no such file ({_EXPECTED_POSITIONS})")
            places = dict.fromkeys(listed_positions(listed, area), (listed,))
        mesh = _mesh_file(Path(self.path), folder.name)
        return [_Room(area, room, mesh, places[room]) for room in sorted(places)]


def _mesh_file(root: Path, area: str) -> Path:
    return root / area / "3d" / "semantic.obj"


def _outside(point: Floats, box: Floats) -> float:
    return float(np.linalg.norm(point - np.clip(point, box[0], box[1])))
