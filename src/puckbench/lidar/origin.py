"""Where a sensor can stand in a scene when nobody says where."""

from __future__ import annotations

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh, check_mesh
from puckbench.lidar.placement import INSIDE, seen_around
from puckbench.lidar.raycast import RayCaster

_GRID = 100
# Distances to all spots would take seconds in a big scene; the first few hundred mostly do.
_AT_A_TIME = 256


def free_origin(
    mesh: Mesh, height: float = 1.3, clearance: float = 0.3, inside: float = INSIDE
) -> Floats:
    """The free spot nearest to the middle of the floor plan, `height` m above the floor, (3,).

    Free: no surface within `clearance` m, and inside the scene: something is straight below, and
    more than the share `inside` of rays in all directions hit the scene. Spots are tried on a
    grid of at least 5 cm.
    Raises InputError when there is none.
    """
    check_mesh(mesh, "the mesh to scan")
    low, high = mesh.bounds()
    middle = (low + high) / 2
    caster = RayCaster(mesh, middle)
    spots = _grid(high - low)
    spots[:, 2] = _floor(caster, spots, high - low) + height
    standing = spots[np.isfinite(_below(caster, spots))]
    for some in np.split(standing, range(_AT_A_TIME, len(standing), _AT_A_TIME)):
        for spot in some[caster.clearances(some) >= clearance]:
            if np.isfinite(seen_around(caster, spot)[0]).mean() > inside:
                return np.asarray(middle + spot)
    raise InputError(
        f"the scene has no free spot {height} m above its floor with {clearance} m around it:"
        " give the sensor's origin"
    )


def _grid(size: Floats) -> Floats:
    """Places over the floor plan relative to its middle, nearest first, (n, 3) with z = 0."""
    spacing = max(0.05, float(size[:2].max()) / _GRID)
    x, y = (np.arange(-(n := int(side / 2 / spacing)), n + 1) * spacing for side in size[:2])
    places = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return places[np.argsort(np.hypot(places[:, 0], places[:, 1]), kind="stable")]


def _floor(caster: RayCaster, places: Floats, size: Floats) -> float:
    """Height of the floor: the level above which nine in ten looks down from mid height end.

    Not the lowest vertex: a floor can have a thickness, and a captured room stray points below.
    """
    levels = -_below(caster, places)
    levels = levels[np.isfinite(levels)]
    return float(np.quantile(levels, 0.1)) if len(levels) else float(-size[2] / 2)


def _below(caster: RayCaster, places: Floats) -> Floats:
    """Distance from each place straight down to a surface, inf where there is none, (n,)."""
    return caster.met(places, np.tile([0.0, 0.0, -1.0], (len(places), 1)))[0]
