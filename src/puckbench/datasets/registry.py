"""The table of scene sets and how to open one from the configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from puckbench.core.errors import InputError
from puckbench.core.plugins import load_class
from puckbench.datasets.scene import SceneSet

REGISTRY = {
    "calibration": "puckbench.datasets.calibration:Calibration",
    "capod": "puckbench.datasets.capod:Capod",
    "captured_rooms": "puckbench.datasets.captured_rooms:CapturedRooms",
    "embedded_areas": "puckbench.datasets.embedded_areas:EmbeddedAreas",
    "embedded_objects": "puckbench.datasets.embedded_objects:EmbeddedObjects",
    "embedded_rooms": "puckbench.datasets.embedded_rooms:EmbeddedRooms",
    "front3d": "puckbench.datasets.front3d:Front3D",
    "kitti": "puckbench.datasets.kitti:Kitti",
    "matterport3d": "puckbench.datasets.matterport3d:Matterport3D",
    "mesh_folder": "puckbench.datasets.mesh_folder:MeshFolder",
    "modelnet40": "puckbench.datasets.modelnet40:ModelNet40",
    "s3dis": "puckbench.datasets.s3dis:S3DIS",
    "scannet": "puckbench.datasets.scannet:ScanNet",
    "shapenetcore": "puckbench.datasets.shapenetcore:ShapeNetCore",
    "stanford2d3d": "puckbench.datasets.stanford2d3d:Stanford2D3D",
    "stanford_scans": "puckbench.datasets.stanford_scans:StanfordScans",
    "sweethome3d": "puckbench.datasets.sweethome3d:SweetHome3D",
    "voxelised8i": "puckbench.datasets.voxelised8i:Voxelised8i",
}


def open_scene_set(loader: str, options: Mapping[str, Any], seed: int = 0) -> SceneSet:
    """Open the scene set of a loader: a name of `REGISTRY`, ``module:Class`` or ``file.py:Class``.

    `seed` goes to loaders that have one, unless the options give their own. InputError for an
    unknown loader, an unknown option, or one that is missing or of the wrong kind.
    """
    where = REGISTRY.get(loader, loader)
    if ":" not in where:
        raise InputError(f"unknown loader '{loader}' (known: {', '.join(REGISTRY)})")
    loader_class = load_class(where, f"loader {loader}")
    if not hasattr(loader_class, "__dataclass_fields__"):
        raise InputError(f"loader {loader}: {where} is not a dataclass")
    known = {field.name: field for field in fields(loader_class)}
    for option in options:
        if option not in known:
            allowed = ", ".join(known)
            raise InputError(f"loader {loader}: unknown option '{option}' (known: {allowed})")
    given = {"seed": seed, **options} if "seed" in known else dict(options)
    for name, field in known.items():
        if name not in given and field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"loader {loader}: the option '{name}' is missing")
    checked = {name: _checked(loader, name, known[name].type, given[name]) for name in given}
    scenes: SceneSet = loader_class(**checked)
    return scenes


_KINDS: dict[str, tuple[type, ...]] = {
    "bool": (bool,),
    "float": (float, int),
    "int": (int,),
    "str": (str,),
    "tuple[str, ...]": (list, tuple),
    "None": (type(None),),
}


def _checked(loader: str, name: str, annotation: Any, value: Any) -> Any:
    """The value, lists as tuples; InputError unless it is of an annotated kind."""
    allowed = [kind.strip() for kind in str(annotation).split("|")]
    if any(kind not in _KINDS for kind in allowed):
        return value
    fits = any(
        isinstance(value, _KINDS[kind]) and (not isinstance(value, bool) or kind == "bool")
        for kind in allowed
    )
    if not fits:
        said = " or ".join("a list of names" if "tuple" in kind else kind for kind in allowed)
        raise InputError(f"loader {loader}: option '{name}' is {value!r}, which is not {said}")
    return tuple(str(item) for item in value) if isinstance(value, list) else value
