from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from virtual_lidar.scenes import household, outdoors, tools
from virtual_lidar.scenes.bodies import Item, build_mesh, moved
from virtual_lidar.scenes.modeller import Modeller

MEMBERS = 12
"""Number of objects of each class."""


class ObjectClass(NamedTuple):
    """A class of generated objects, such as chairs.

    Parameters
    ----------
    make
        Function that makes the object with a given number.
    unit
        `Modeller.unit` for this function.
    """

    make: Callable[[Modeller, int], Item]
    unit: float


CLASSES: dict[str, ObjectClass] = {
    "airplane": ObjectClass(outdoors.airplane, 0.2),
    "bottle": ObjectClass(household.bottle, 8.0),
    "car": ObjectClass(outdoors.car, 0.6),
    "chair": ObjectClass(household.chair, 3.0),
    "cup": ObjectClass(household.cup, 8.0),
    "gear": ObjectClass(tools.gear, 4.0),
    "guitar": ObjectClass(household.guitar, 4.0),
    "hammer": ObjectClass(tools.hammer, 4.0),
    "lamp": ObjectClass(household.lamp, 3.0),
    "pipe_fitting": ObjectClass(tools.pipe_fitting, 3.0),
    "screw": ObjectClass(tools.screw, 3.0),
    "spectacles": ObjectClass(household.spectacles, 10.0),
    "table": ObjectClass(household.table, 6.0),
    "tree": ObjectClass(outdoors.tree, 0.6),
    "vase": ObjectClass(household.vase, 3.0),
}
OBJECTS: tuple[str, ...] = tuple(
    f"{name}_{member:02d}" for name in CLASSES for member in range(1, MEMBERS + 1)
)


def make_object(name: str, seed: int, detail: float = 1.0) -> Mesh:
    """Generate a household, outdoor or workshop object as a labelled mesh.

    Parameters
    ----------
    name
        One of `OBJECTS`, such as ``chair_03``.
    seed
        Seed of all random choices; the same name and seed give the same object.
    detail
        Factor by which curved parts have more segments than by default.

    Returns
    -------
    Mesh
        The object on the plane z = 0, scaled so that its longest side is 1. Labels name the part of
        each triangle, the semantic class of this part, and the geometric primitive on which the
        triangle lies (such as "cylinder").

    Raises
    ------
    InputError
        There is no such object.
    """
    if name not in OBJECTS:
        expected = f"one of {', '.join(CLASSES)} and _01 to _{MEMBERS:02d}"
        raise InputError(f"object {name!r}: expected {expected}")
    kind, _, member = name.rpartition("_")
    spec = CLASSES[kind]
    cad = Modeller(generator(seed, "object", name), detail, spec.unit)
    return build_mesh(_normalised(spec.make(cad, int(member) - 1)))


def _normalised(item: Item) -> Item:
    corners = np.stack([body.placed().bounds() for body in item])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    scale = 1.0 / float((high - low).max())
    x, y = -(low + high)[:2] / 2 * scale
    return moved(item, float(x), float(y), -float(low[2]) * scale, scale=scale)
