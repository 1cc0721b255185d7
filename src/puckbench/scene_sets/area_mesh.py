from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Labels, Mesh, SceneObject, check_mesh
from puckbench.scene_sets.base import freeform_labels

CODE = ("cloud_files.meshes.obj",)

UNKNOWN = "unknown"

# Materials are called class_instance_roomtype_room_area; an exporter may append ".001".
_MATERIAL = re.compile(r"(.+)_\d+_([A-Za-z]+_\d+)_\d[ab]?(?:\.\d+)?")

# Area 5 is two meshes with a frame each, S3DIS has it in that of 5a. Both numbers are from the
# data set's issue 40 and confirmed by the tripods of the four hallways that run through both.
_FROM_5B = (-4.09703582, 6.22617759)
# The clouds were sampled on the meshes: their boxes may end short of a wall, but not by more.
_TOLERANCE_M = 0.1


def in_frame_of_s3dis(points: Floats, area: str) -> Floats:
    if area != "5b":
        return points
    x, y, z = points.T
    return np.stack([y + _FROM_5B[0], _FROM_5B[1] - x, z], axis=1)


@dataclass(frozen=True)
class AreaMesh:
    """The mesh of an area (building part) of 2D-3D-S, from which rooms are cut.

    It is in S3DIS's coordinate frame, in metres with z up. `materials` are names that contain class
    and room. `material_id` (t,) is the index of each triangle's material, or -1.
    """

    mesh: Mesh
    materials: tuple[str, ...]
    material_id: NDArray[np.int64]

    def share_inside(self, room: str, box: Floats) -> float:
        """Return the fraction of a room's triangles whose centroids lie in a box.

        If no triangle has the room's label, the result is 1 if the box contains any centroid, else
        0.

        Parameters
        ----------
        room
            Name of the room, as in the materials.
        box
            Lowest and highest corner (2, 3), in m.
        """
        low, high = box[0] - _TOLERANCE_M, box[1] + _TOLERANCE_M
        inside = ((self._middles >= low) & (self._middles <= high)).all(axis=1)
        of_room = [room_of(material) == room for material in self.materials]
        is_of_room = np.array([*of_room, False])[self.material_id]
        return float(inside[is_of_room].mean() if is_of_room.any() else inside.any())

    def near(self, box: Floats, margin: float) -> Mesh:
        low, high = self._extent
        rows = ((high >= box[0] - margin) & (low <= box[1] + margin)).all(axis=1)
        rows &= self.mesh.areas() > 0
        used, triangles = np.unique(self.mesh.triangles[rows], return_inverse=True)
        labels = _labels(self.materials, self.material_id[rows])
        return Mesh(self.mesh.vertices[used], triangles.reshape(-1, 3), labels)

    @cached_property
    def _extent(self) -> tuple[Floats, Floats]:
        corners = self.mesh.corners()
        return corners.min(axis=1), corners.max(axis=1)

    @cached_property
    def _middles(self) -> Floats:
        return np.asarray(self.mesh.corners().mean(axis=1))


def read_area_mesh(path: Path, area: str) -> AreaMesh:
    """Read the mesh of an area from its file ``semantic.obj``.

    The mesh that was read last is cached. Raises InputError if the file is missing.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    return _read(path, area, path.stat().st_mtime_ns)


@lru_cache(maxsize=1)
def _read(path: Path, area: str, _modified_ns: int) -> AreaMesh:
    from cloud_files.meshes.obj import read_obj
    from cloud_files.meshes.polygons import triangulate
    from cloud_files.meshes.reading import y_up_to_z_up

    polygons = read_obj(path)
    if polygons.material_id is None:
        raise InputError(f"{path}: faces need materials, which name object and room")
    mesh, face = triangulate(polygons, str(path))
    check_mesh(mesh, str(path))
    vertices = in_frame_of_s3dis(y_up_to_z_up(mesh.vertices), area)
    return AreaMesh(Mesh(vertices, mesh.triangles), polygons.materials, polygons.material_id[face])


def class_of(material: str) -> str:
    match = _MATERIAL.fullmatch(material)
    return match[1] if match else UNKNOWN


def room_of(material: str) -> str | None:
    match = _MATERIAL.fullmatch(material)
    return match[2] if match else None


def _labels(materials: tuple[str, ...], material_id: NDArray[np.int64]) -> Labels:
    used, object_id = np.unique(material_id, return_inverse=True)
    names = [materials[number] if number >= 0 else UNKNOWN for number in used]
    objects = (SceneObject(name, class_of(name)) for name in names)
    return freeform_labels(object_id.astype(np.int32), objects)
