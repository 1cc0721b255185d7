"""Compiled loops of a virtual scan, which write their results to arguments.

Rays, flat arrays (n,) and rows of the scan table are ordered by frame, azimuth step and laser.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats

# Below this cosine between ray and normal, Embree's distance is more accurate than the plane's.
_LEAST_COSINE = 1e-9


@compiled
def fill_planes(
    vertices: Floats, triangles: NDArray[np.int64], origin: Floats, planes: Floats
) -> None:
    """Compute planes (t, 4) of triangles: unit normal (0 if degenerate), distance from `origin`."""
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        x1, y1, z1 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        x2, y2, z2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0:
            x, y, z = x / length, y / length, z / length
        away = x * (a[0] - origin[0]) + y * (a[1] - origin[1]) + z * (a[2] - origin[2])
        planes[t, 0], planes[t, 1], planes[t, 2], planes[t, 3] = x, y, z, away


@compiled
def fill_directions(
    yaw: tuple[Floats, Floats],
    pitch: tuple[Floats, Floats],
    rotations: Floats,
    directions: Floats,
    rays: NDArray[np.float32],
) -> None:
    """Compute the directions (n, 3) of rays in the world.

    `yaw` and `pitch` are pairs: sines and cosines of the rays' angles, each (frames, steps,
    lasers). `rotations` (frames, steps, 3, 3) rotate from the sensor to the world. The last three
    columns of `rays` (n, 6) also receive the directions, for Embree.
    """
    frames, steps, lasers = yaw[0].shape
    ray = 0
    for f in range(frames):
        for s in range(steps):
            for k in range(lasers):
                x = -yaw[0][f, s, k] * pitch[1][f, s, k]
                y = yaw[1][f, s, k] * pitch[1][f, s, k]
                z = pitch[0][f, s, k]
                for row in range(3):
                    turn = rotations[f, s, row]
                    value = turn[0] * x + turn[1] * y + turn[2] * z
                    directions[ray, row] = value
                    rays[ray, 3 + row] = value
                ray += 1


@compiled
def fill_distances(
    directions: Floats,
    nearest: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    planes: Floats,
    starts: Floats,
    limits: tuple[float, float],
    distances: Floats,
    cosines: Floats,
) -> None:
    """Compute distances, m, of rays (n,) in float64, and cosines of incidence angles.

    A miss has inf and nan. `nearest` (n,), distances (inf for a miss), and `triangles` (n,) come
    from Embree, `planes` (t, 4) from `fill_planes`. `starts` (steps, 3) are ray origins in the
    coordinates of `planes`, `limits` the shortest and longest range. A ray parallel to its plane
    keeps Embree's distance.
    """
    per_step = len(directions) // len(starts)
    for ray in range(len(directions)):
        distances[ray], cosines[ray] = np.inf, np.nan
        if not np.isfinite(nearest[ray]):
            continue
        plane, direction = planes[triangles[ray]], directions[ray]
        cosine = plane[0] * direction[0] + plane[1] * direction[1] + plane[2] * direction[2]
        distance = float(nearest[ray])
        if abs(cosine) > _LEAST_COSINE:
            start = starts[ray // per_step]
            away = plane[0] * start[0] + plane[1] * start[1] + plane[2] * start[2]
            distance = (plane[3] - away) / cosine
        if limits[0] <= distance <= limits[1]:
            distances[ray], cosines[ray] = distance, min(abs(cosine), 1.0)


@compiled
def fill_rays(
    rows: NDArray[np.bool_],
    nominal: tuple[Floats, Floats, Floats],
    first_frame: int,
    start: int,
    out: tuple[Any, ...],
) -> int:
    """Write frame, laser, time and angles of the rays that `rows` (frames, steps, lasers) selects.

    `nominal` has the timestamp, yaw and pitch of all rays. The columns `out` are written from row
    `start` on. Returns the next free row.
    """
    frame, laser, timestamp, yaw, pitch = out
    row = start
    for f in range(rows.shape[0]):
        for s in range(rows.shape[1]):
            for k in range(rows.shape[2]):
                if rows[f, s, k]:
                    frame[row] = first_frame + f
                    laser[row] = k
                    timestamp[row] = nominal[0][f, s, k]
                    yaw[row] = nominal[1][f, s, k]
                    pitch[row] = nominal[2][f, s, k]
                    row += 1
    return row


@compiled
def fill_points(
    rows: NDArray[np.bool_],
    origins: Floats,
    directions: Floats,
    distances: Floats,
    start: int,
    out: tuple[Any, ...],
) -> None:
    distance, x, y, z = out
    per_step = len(rows) // len(origins)
    row = start
    for ray in range(len(rows)):
        if rows[ray]:
            reach, origin = distances[ray], origins[ray // per_step]
            distance[row] = reach
            x[row] = origin[0] + reach * directions[ray, 0]
            y[row] = origin[1] + reach * directions[ray, 1]
            z[row] = origin[2] + reach * directions[ray, 2]
            row += 1


@compiled
def fill_surface(
    rows: NDArray[np.bool_],
    hits: tuple[Floats, NDArray[np.uint32], Floats],
    surface: tuple[Floats, NDArray[np.int32], NDArray[np.int32]],
    start: int,
    out: tuple[Any, ...],
) -> None:
    """Write incidence, triangle, labels and normal (towards the sensor) of the rays in `rows`.

    `rows` is a mask (n,). The columns `out` are written from row `start` on. `hits` are directions
    (n, 3), triangles (n,) and incidence angles (n,) of all rays. `surface` has the plane (t, 4),
    object and primitive of each triangle.
    """
    incidence, triangle, object_id, primitive_id, nx, ny, nz = out
    row = start
    for ray in range(len(rows)):
        if rows[ray]:
            direction, index = hits[0][ray], hits[1][ray]
            plane = surface[0][index]
            along = plane[0] * direction[0] + plane[1] * direction[1] + plane[2] * direction[2]
            side = -1.0 if along > 0 else 1.0
            nx[row], ny[row], nz[row] = side * plane[0], side * plane[1], side * plane[2]
            incidence[row] = hits[2][ray]
            triangle[row] = index
            object_id[row] = surface[1][index]
            primitive_id[row] = surface[2][index]
            row += 1


@compiled
def fill_echoes(
    apart: Floats, gap: float, choice: int, distance: Floats, middle: NDArray[np.int64]
) -> None:
    """Compute the echo of each beam: mean distance (inf for none), and ray nearest to the mean.

    `apart` (beams, rays) are distances of rays, m, inf for a miss. In increasing order, a distance
    more than `gap` beyond the previous one begins a new echo. `choice` selects the first echo (0),
    the largest (1), the last (2), or all rays as one echo (3).
    """
    beams, rays = apart.shape
    for beam in range(beams):
        order = np.argsort(apart[beam])
        distance[beam], middle[beam] = np.inf, order[0]
        start, most = 0, 0
        total = 0.0
        for place in range(rays):
            reach = apart[beam, order[place]]
            if not np.isfinite(reach):
                break
            total += reach
            last = place + 1 == rays or not np.isfinite(apart[beam, order[place + 1]])
            if last or (choice != 3 and apart[beam, order[place + 1]] - reach > gap):
                count = place + 1 - start
                if most == 0 or choice == 2 or (choice == 1 and count > most):
                    most, distance[beam] = count, total / count
                    echo = order[start : place + 1]
                    middle[beam] = echo[np.argmin(np.abs(apart[beam][echo] - distance[beam]))]
                start, total = place + 1, 0.0
