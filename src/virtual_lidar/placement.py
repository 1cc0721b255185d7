"""Checks of a sensor's position or path in a scene, and search for a free position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh, check_mesh
from virtual_lidar.raycast import RayCaster

INSIDE = 0.5
"""A sensor is inside a scene if more than this share of rays in all directions hits the scene."""

# A closer sensor touches the surface: rounding errors decide which side it sees.
_LEAST_CLEARANCE_M = 1e-3
# If all surfaces are closer, the sensor is inside an object.
_LEAST_REACH_M = 1.0
_DIRECTIONS = 256
_IF_MEANT = "(to scan from there, add --anywhere)"


def check_untouched(caster: RayCaster, places: Floats) -> None:
    """Raise InputError if a position of the sensor is within 1 mm of the mesh.

    Parameters
    ----------
    caster
        Ray caster of the mesh.
    places
        Positions, (n, 3), m, relative to the ray caster's origin.
    """
    touching = caster.clearances(places) < _LEAST_CLEARANCE_M
    if touching.any():
        raise InputError(f"the sensor at {_world(caster, places[touching][0])} touches the mesh")


def check_free(caster: RayCaster, times: Floats, places: Floats) -> None:
    """Raise InputError unless a sensor's path begins in free space and crosses no surface.

    Free space is inside the scene and outside of its objects. A start is also refused if everything
    that the sensor sees there is within 1 m.

    Parameters
    ----------
    caster
        Ray caster of the mesh.
    times
        Times of the path's points, (n,), s, from `Sweep.way`.
    places
        Positions of the path's points, (n, 3), m, relative to the ray caster's origin.
    """
    where = f"the sensor at {_world(caster, places[0])}"
    distances, triangles = seen_around(caster, places[0])
    share = np.isfinite(distances).mean()
    if share <= INSIDE:
        raise InputError(
            f"{where} is outside the scene: {share:.0%} of all directions meet it {_IF_MEANT}"
        )
    around = _one_object(caster, triangles) if share == 1 else None
    if around is not None:
        raise InputError(f"{where} is inside {around}, the only object that it sees {_IF_MEANT}")
    if distances.max() < _LEAST_REACH_M:
        raise InputError(
            f"{where} is enclosed: it sees no farther than {distances.max():.2f} m {_IF_MEANT}"
        )
    _check_way(caster, times, places)


def seen_around(caster: RayCaster, place: Floats) -> tuple[Floats, NDArray[np.uint32]]:
    """Cast 256 rays in all directions from a position (3,).

    Returns the distances (256,) in m, inf where nothing is hit, and the numbers of the triangles
    hit, (256,), as `RayCaster.met` does.
    """
    turns = np.arange(_DIRECTIONS) * np.pi * (3 - np.sqrt(5))
    z = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
    around = np.sqrt(1 - z**2)
    directions = np.column_stack([around * np.cos(turns), around * np.sin(turns), z])
    return caster.met(np.broadcast_to(place, directions.shape), directions)


def _one_object(caster: RayCaster, triangles: NDArray[np.uint32]) -> str | None:
    if caster.surfaces is None or len(np.unique(caster.surfaces.object_id)) < 2:
        return None
    seen = np.unique(caster.surfaces.object_id[triangles])
    return caster.surfaces.objects[seen[0]].name if len(seen) == 1 and seen[0] >= 0 else None


def _check_way(caster: RayCaster, times: Floats, places: Floats) -> None:
    steps = np.diff(places, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    moved = np.flatnonzero(lengths)
    if not len(moved):
        return
    ahead, _ = caster.met(places[moved], steps[moved] / lengths[moved, None])
    through = moved[ahead < lengths[moved]]
    if len(through):
        start, end = times[through[0]], times[through[0] + 1]
        raise InputError(
            f"the sensor goes through a surface between {start:g} and {end:g} s {_IF_MEANT}"
        )


def _world(caster: RayCaster, place: Floats) -> list[float]:
    return [float(x) for x in caster.origin + place]


_GRID = 100
# The first few hundred places usually suffice; distances from all would take seconds.
_AT_A_TIME = 256


def free_origin(
    mesh: Mesh, height: float = 1.3, clearance: float = 0.3, inside: float = INSIDE
) -> Floats:
    """Find a position in a scene at which a sensor has space around it and a floor below it.

    Parameters
    ----------
    mesh
        The scene, m, z up.
    height
        Height of the sensor above the floor, m.
    clearance
        Least distance of the position from all surfaces, m.
    inside
        A position counts as inside the scene if more than this share (0 to 1) of rays in all
        directions hits the scene.

    Returns
    -------
    array
        Position (3,), m. It is the free position nearest to the middle of the scene, among those on
        a grid.

    Raises
    ------
    InputError
        There is no such position, or the mesh has no faces.
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
        f"the scene has no free position {height} m above its floor with {clearance} m around it:"
        " give the sensor's origin"
    )


def _grid(size: Floats) -> Floats:
    spacing = max(0.05, float(size[:2].max()) / _GRID)
    x, y = (np.arange(-(n := int(side / 2 / spacing)), n + 1) * spacing for side in size[:2])
    places = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return places[np.argsort(np.hypot(places[:, 0], places[:, 1]), kind="stable")]


def _floor(caster: RayCaster, places: Floats, size: Floats) -> float:
    levels = -_below(caster, places)
    levels = levels[np.isfinite(levels)]
    # A quantile, since floors have a thickness, and captured rooms have stray points below them.
    return float(np.quantile(levels, 0.1)) if len(levels) else float(-size[2] / 2)


def _below(caster: RayCaster, places: Floats) -> Floats:
    return caster.met(places, np.tile([0.0, 0.0, -1.0], (len(places), 1)))[0]
