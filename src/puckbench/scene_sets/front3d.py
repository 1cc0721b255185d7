"""3D-FRONT: designed rooms (Fu 2021) with furniture from 3D-FUTURE."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from puckbench.scene_sets.base import Count, SceneSet, existing_folder, look_up, select_names
from puckbench.scene_sets.front3d_house import HouseRoom, build_room, read_rooms
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name, unique_names

CODE = ("puckbench.scene_sets.front3d_house",)

_HOUSES = 6813
_EXPECTED = (
    "expected 3D-FRONT's houses (<id>.json), available from Alibaba on request, "
    "tianchi.aliyun.com, data sets 3D-FRONT and 3D-FUTURE"
)
_EXPECTED_MODELS = (
    "expected 3D-FUTURE's models (<id>/raw_model.obj), available from Alibaba on request, "
    "tianchi.aliyun.com, data set 3D-FUTURE"
)
_CREDIT = (
    'H. Fu et al., "3D-FRONT: 3D Furnished Rooms with layOuts and semaNTics", ICCV 2021; '
    '"3D-FUTURE: 3D Furniture shape with TextURE", IJCV 2021'
)


@LOADERS.register("front3d")
class Front3D(SceneSet):
    """The scenes are rooms of houses ``<id>.json`` with furniture ``<model>/raw_model.obj``.

    Houses come from 3D-FRONT, and furniture from 3D-FUTURE. All 6,813 houses are read to list their
    rooms, so selecting houses saves minutes. Scenes are named <house>_LivingRoom-1234 and grouped
    by room type. Units are metres, and y up is rotated to z up. Walls, floors and furniture are
    labelled. Furniture without ``valid: true`` or a model file is left out and counted in `about`.
    """

    path: str
    """Folder of the houses."""
    models: str
    """The folder 3D-FUTURE-model."""
    houses: tuple[str, ...] | int | None = None
    """Names of houses, or n for the first n houses; all by default."""

    def names(self) -> list[str]:
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        house, room = look_up(self._table, name, self.path)
        return [house, *(path for path in room.models(Path(self.models)) if path.is_file())]

    def load(self, name: str) -> Scene:
        house, room = look_up(self._table, name, self.path)
        folder = existing_folder(self.models, _EXPECTED_MODELS)
        mesh, box, left_out = build_room(room, folder, f"{house}: {room.name}")
        about: dict[str, Any] = {
            "source": f"3D-FRONT {house.name} {room.name}",
            "licence": "Alibaba's terms of 3D-FRONT and 3D-FUTURE: research, not redistributable",
            "credit": _CREDIT,
            "left_out": left_out,
            "triangles": len(mesh.triangles),
        }
        return Scene(name, safe_name(room.kind).lower(), mesh=mesh, box=box, about=about)

    def counts(self) -> list[Count]:
        return [Count("houses", len(self._houses), _HOUSES)]

    @cached_property
    def _houses(self) -> dict[str, Path]:
        folder = existing_folder(self.path, _EXPECTED)
        paths = sorted(path for path in folder.glob("*.json") if not path.name.startswith("."))
        if not paths:
            raise InputError(f"{self.path}: no houses (.json) ({_EXPECTED})")
        return {path.stem: path for path in paths}

    @cached_property
    def _table(self) -> dict[str, tuple[Path, HouseRoom]]:
        requested = select_names("houses", self.houses, list(self._houses))
        rooms = [(self._houses[h], room) for h in requested for room in read_rooms(self._houses[h])]
        if not rooms:
            raise InputError(f"{self.path}: no rooms in the selected houses")
        names = unique_names(f"{house.stem}_{room.name}" for house, room in rooms)
        return dict(zip(names, rooms, strict=True))
