"""Whether a sensor can stand, or move, where it was told to: free, within the scene, not walled in.

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
from puckbench.lidar.raycast import RayCaster

INSIDE = 0.5
"""More than this share of all directions meets the scene that a sensor stands in."""

# A sensor that is nearer to a surface touches it: it would see one side or the other by chance.
_LEAST_CLEARANCE_M = 1e-3
# What encloses a sensor more tightly than this is no room to scan but a thing that it is in.
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
