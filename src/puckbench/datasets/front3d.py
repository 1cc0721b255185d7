"""3D-FRONT's designed rooms (Fu 2021), furnished with the models of 3D-FUTURE."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from puckbench.core.errors import InputError
from puckbench.datasets.base import DataSet, chosen, existing_folder, found
from puckbench.datasets.front3d_house import Room, build_room, read_rooms
from puckbench.datasets.published_counts import Count
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene, safe_name, unique_names

_HOUSES = 6813
_EXPECTED = (
    "3D-FRONT's houses (<id>.json) should lie there; Alibaba gives them on request, "
    "tianchi.aliyun.com, data sets 3D-FRONT and 3D-FUTURE"
)
_EXPECTED_MODELS = (
    "3D-FUTURE's models, <id>/raw_model.obj, should lie there; Alibaba gives them on request, "
    "tianchi.aliyun.com, data set 3D-FUTURE"
)
_CREDIT = (
    'H. Fu et al., "3D-FRONT: 3D Furnished Rooms with layOuts and semaNTics", ICCV 2021; '
    '"3D-FUTURE: 3D Furniture shape with TextURE", IJCV 2021'
)


@LOADERS.register("front3d")
class Front3D(DataSet):
    """Rooms of the houses ``<id>.json``, with furniture ``<model>/raw_model.obj``.

    Rooms are listed inside the houses: the whole set has 6,813, so naming some saves minutes.
    Scenes are called <house>_LivingRoom-1234 and grouped by room type. In metres; y is up, and
    turned to z. Walls, floors and furniture are labelled objects. Furniture without ``valid: true``
    has no model and is left out, counted in `about`, as are models whose file is missing.
    """

    of_clouds: ClassVar[bool] = False
    path: str
    """Folder of the houses."""
    models: str
    """The folder 3D-FUTURE-model."""
    houses: tuple[str, ...] | int | None = None
    """Names of houses, or the number of houses from the first on; all by default."""

    def names(self) -> list[str]:
        """House and room of every room that has a surface."""
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        """The house, and the models of the room's furniture."""
        house, room = found(self._table, name, self.path)
        return [house, *(path for path in room.models(Path(self.models)) if path.is_file())]

    def load(self, name: str) -> Scene:
        """Put walls, floors and furniture in their places."""
        house, room = found(self._table, name, self.path)
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
        """Houses."""
        return [Count("houses", len(self._houses), _HOUSES)]

    @cached_property
    def _houses(self) -> dict[str, Path]:
        folder = existing_folder(self.path, _EXPECTED)
        paths = sorted(path for path in folder.glob("*.json") if not path.name.startswith("."))
        if not paths:
            raise InputError(f"{self.path}: no houses (.json) there ({_EXPECTED})")
        return {path.stem: path for path in paths}

    @cached_property
    def _table(self) -> dict[str, tuple[Path, Room]]:
        wanted = chosen("houses", self.houses, list(self._houses))
        rooms = [(self._houses[h], room) for h in wanted for room in read_rooms(self._houses[h])]
        if not rooms:
            raise InputError(f"{self.path}: no rooms in the houses chosen")
        names = unique_names(f"{house.stem}_{room.name}" for house, room in rooms)
        return dict(zip(names, rooms, strict=True))
