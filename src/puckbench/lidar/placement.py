"""Where a sensor can stand or move in a scene: in free space, within it, and not walled in.

From outside of a convex scene less than half of all directions meet it, and from inside a closed
one all do. So a sensor is taken to be outside where no more than half of them do; only in a notch
of the scene (a courtyard) can more of them. A scene that is open by nature (a yard, a wall alone)
is scanned by saying that the place is meant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh, check_mesh
from puckbench.lidar.raycast import RayCaster

INSIDE = 0.5
"""More than this share of all directions meets the scene that a sensor stands in."""

# A sensor that is nearer to a surface touches it: it would see one side or the other by chance.
_LEAST_CLEARANCE_M = 1e-3
# What encloses a sensor more tightly than this is no room to scan but an object that it is in.
_LEAST_REACH_M = 1.0
_DIRECTIONS = 256
_IF_MEANT = "(--anywhere scans from there all the same)"


def check_untouched(caster: RayCaster, places: Floats) -> None:
    """InputError where a place, (n, 3) from the caster's origin, touches the mesh."""
    touching = caster.clearances(places) < _LEAST_CLEARANCE_M
    if touching.any():
        raise InputError(f"the sensor at {_world(caster, places[touching][0])} touches the mesh")


def check_free(caster: RayCaster, times: Floats, places: Floats) -> None:
    """InputError unless a sensor's way, as `Sweep.way` has it, begins in the scene's free space.

    And stays there: it goes through no surface.
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
        raise InputError(f"{where} is inside of {around}, which is all that it sees {_IF_MEANT}")
    if distances.max() < _LEAST_REACH_M:
        raise InputError(f"{where} is shut in: it sees {distances.max():.2f} m far {_IF_MEANT}")
    _check_way(caster, times, places)


def seen_around(caster: RayCaster, place: Floats) -> tuple[Floats, NDArray[np.uint32]]:
    """Distances and triangles that rays evenly spread over the sphere meet, (256,) each.

    A ray without a hit has distance inf.
    """
    turns = np.arange(_DIRECTIONS) * np.pi * (3 - np.sqrt(5))
    z = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
    around = np.sqrt(1 - z**2)
    directions = np.column_stack([around * np.cos(turns), around * np.sin(turns), z])
    return caster.met(np.broadcast_to(place, directions.shape), directions)


def _one_object(caster: RayCaster, triangles: NDArray[np.uint32]) -> str | None:
    """The object that all of the triangles belong to, in a scene that has others."""
    if caster.surfaces is None or len(np.unique(caster.surfaces.object_id)) < 2:
        return None
    seen = np.unique(caster.surfaces.object_id[triangles])
    return caster.surfaces.objects[seen[0]].name if len(seen) == 1 and seen[0] >= 0 else None


def _check_way(caster: RayCaster, times: Floats, places: Floats) -> None:
    """InputError where a straight part of a sensor's way goes through a surface."""
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
# Distances to all spots would take seconds in a big scene; the first few hundred mostly do.
_AT_A_TIME = 256


def free_origin(
    mesh: Mesh, height: float = 1.3, clearance: float = 0.3, inside: float = INSIDE
) -> Floats:
    """Find the free spot nearest to the middle of the floor plan, (3,), m.

    Spots are tried on a grid of at least 5 cm.

    Parameters
    ----------
    mesh
        The scene, metres, z up.
    height
        Of the spot above the floor, m.
    clearance
        No surface is nearer to it than this, m.
    inside
        More than this share of rays in all directions meet the scene, and one straight down does.

    Raises
    ------
    InputError
        There is no such spot.
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
    """Height of the floor: above it end nine of ten rays straight down from mid height.

    Not the lowest vertex: a floor can have a thickness, and a captured room stray points below.
    """
    levels = -_below(caster, places)
    levels = levels[np.isfinite(levels)]
    return float(np.quantile(levels, 0.1)) if len(levels) else float(-size[2] / 2)


def _below(caster: RayCaster, places: Floats) -> Floats:
    """Distance from each place straight down to a surface, inf where there is none, (n,)."""
    return caster.met(places, np.tile([0.0, 0.0, -1.0], (len(places), 1)))[0]
