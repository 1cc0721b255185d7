"""Compiled loops of a virtual scan, which write their results to arguments.

Rays are in the order of firing: by frame, azimuth step, and ray of the azimuth step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled, inlined
from pointkit.geometry.cloud import Floats

_LEAST_COSINE = 1e-9
"""Below this cosine between ray and normal, Embree's distance is more accurate than the plane's."""
ECHOES = ("first", "strongest", "last", "mean")
"""What `fill_echoes` can choose, in the order of its numbers."""


@inlined
def _dot(a: Floats, b: Floats) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _value(values: Floats, frame: int, step: int, ray: int) -> Any:
    frames, steps, rays = values.shape
    return values[min(frame, frames - 1), min(step, steps - 1), min(ray, rays - 1)]


@compiled
def fill_planes(
    vertices: Floats, triangles: NDArray[np.int64], origin: Floats, planes: Floats
) -> None:
    """Compute the planes of triangles.

    Parameters
    ----------
    vertices
        Coordinates, (v, 3), m.
    triangles
        Indices (t, 3) of the vertices of each triangle.
    origin
        Point (3,), m, from which distances of the planes are measured.
    planes
        Receives unit normals (0 for a triangle without area) and distances (m), (t, 4).
    """
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        cx, cy, cz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0:
            x, y, z = x / length, y / length, z / length
        planes[t, 0], planes[t, 1], planes[t, 2] = x, y, z
        planes[t, 3] = x * (a[0] - origin[0]) + y * (a[1] - origin[1]) + z * (a[2] - origin[2])


@compiled
def fill_directions(
    yaw: tuple[Floats, Floats],
    pitch: tuple[Floats, Floats],
    rotations: Floats,
    directions: Floats,
) -> None:
    """Compute the directions of rays in world coordinates.

    Parameters
    ----------
    yaw, pitch
        Sines and cosines of the angles, each (frames, azimuth steps, rays of an azimuth step). An
        axis may have length 1 if all values along it are equal.
    rotations
        Rotation matrices from sensor to world coordinates, (frames, azimuth steps, 3, 3).
    directions
        Receives the unit vectors, (n, 3).
    """
    frames, steps = rotations.shape[:2]
    rays = len(directions) // (frames * steps)
    row = 0
    for f in range(frames):
        for s in range(steps):
            for k in range(rays):
                level, z = _value(pitch[1], f, s, k), _value(pitch[0], f, s, k)
                x, y = -_value(yaw[0], f, s, k) * level, _value(yaw[1], f, s, k) * level
                for axis in range(3):
                    turn = rotations[f, s, axis]
                    directions[row, axis] = turn[0] * x + turn[1] * y + turn[2] * z
                row += 1


@compiled
def fill_distances(
    directions: Floats,
    starts: Floats,
    nearest: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    planes: Floats,
    limits: tuple[float, float],
    distances: Floats,
    cosines: Floats,
) -> None:
    """Compute exact distances along n rays to the planes of the triangles that the rays meet.

    Parameters
    ----------
    directions
        Unit vectors, (n, 3).
    starts
        Starting points of the rays, (n, 3), m, or fewer: each then belongs to the same number of
        successive rays.
    nearest
        Distances of float32 accuracy, (n,), m; inf for a ray that meets nothing. They are kept for
        rays that are nearly parallel to their planes.
    triangles
        Number of the triangle that each ray meets, (n,).
    planes
        Unit normal and distance (m) of each triangle's plane, (t, 4).
    limits
        Least and greatest distance of a hit, m.
    distances
        Receives the distances, (n,), m; inf without a hit.
    cosines
        Receives the cosines of the incidence angles, (n,); nan without a hit.
    """
    rays = len(directions) // max(len(starts), 1)
    for ray in range(len(directions)):
        distances[ray], cosines[ray] = np.inf, np.nan
        distance = float(nearest[ray])
        if not np.isfinite(distance):
            continue
        plane = planes[triangles[ray]]
        cosine = _dot(plane, directions[ray])
        if abs(cosine) > _LEAST_COSINE:
            distance = (plane[3] - _dot(plane, starts[ray // rays])) / cosine
        if limits[0] <= distance <= limits[1]:
            distances[ray], cosines[ray] = distance, min(abs(cosine), 1.0)


class TrueRays(NamedTuple):
    """Nominal rays and what they hit.

    Parameters
    ----------
    times, yaw, pitch
        Time of firing (s) and nominal angles (rad), each (frames, azimuth steps, lasers). An axis
        may have length 1 if all values along it are equal.
    origins
        Position of the sensor in each azimuth step, (frames * azimuth steps, 3), m.
    directions
        Unit vectors, (n, 3).
    distances, triangles, incidences
        Distances (m), numbers of triangles and incidence angles (rad), each (n,).
    """

    times: Floats
    yaw: Floats
    pitch: Floats
    origins: Floats
    directions: Floats
    distances: Floats
    triangles: NDArray[np.uint32]
    incidences: Floats


class MeasuredRays(NamedTuple):
    """What the sensor reports for each ray: the direction, and how far away the point is.

    Parameters
    ----------
    directions
        Unit vectors, (n, 3).
    distances
        Measured distances, (n,), m.
    lifts
        Lengths by which points are moved along the normal, (n,), m; empty if no point is moved.
    """

    directions: Floats
    distances: Floats
    lifts: Floats


@compiled
def fill_returns(
    returned: NDArray[np.bool_],
    first_frame: int,
    true: TrueRays,
    measured: MeasuredRays,
    surface: tuple[Floats, NDArray[np.int32], NDArray[np.int32]],
    columns: tuple[Any, ...],
) -> None:
    """Write the rays that have returned into the columns of a scan's table.

    Parameters
    ----------
    returned
        Which of the n rays have returned, (frames, azimuth steps, lasers).
    first_frame
        Number of the first frame.
    true, measured
        The rays.
    surface
        Plane (t, 4), object (t,) and primitive (t,) of each triangle.
    columns
        Receive the returns: arrays in the order of `virtual_lidar.scan_table.COLUMNS`.
    """
    timestamp, frame, laser_id, yaw, pitch, distance, distance_noisy = columns[:7]
    x, y, z, x_noisy, y_noisy, z_noisy = columns[7:13]
    incidence, object_id, primitive_id, triangle_id, nx, ny, nz = columns[13:]
    planes, objects, primitives = surface
    frames, steps, lasers = returned.shape
    row, ray = 0, -1
    for f in range(frames):
        for s in range(steps):
            start = true.origins[f * steps + s]
            for k in range(lasers):
                ray += 1
                if not returned[f, s, k]:
                    continue
                timestamp[row] = _value(true.times, f, s, k)
                frame[row], laser_id[row] = first_frame + f, k
                yaw[row], pitch[row] = _value(true.yaw, f, s, k), _value(true.pitch, f, s, k)
                along, reach = true.directions[ray], true.distances[ray]
                distance[row] = reach
                x[row] = start[0] + reach * along[0]
                y[row] = start[1] + reach * along[1]
                z[row] = start[2] + reach * along[2]
                triangle = true.triangles[ray]
                plane = planes[triangle]
                side = -1.0 if _dot(plane, along) > 0 else 1.0
                nx[row], ny[row], nz[row] = side * plane[0], side * plane[1], side * plane[2]
                incidence[row], triangle_id[row] = true.incidences[ray], triangle
                object_id[row], primitive_id[row] = objects[triangle], primitives[triangle]
                along, reach = measured.directions[ray], measured.distances[ray]
                px = start[0] + reach * along[0]
                py = start[1] + reach * along[1]
                pz = start[2] + reach * along[2]
                if len(measured.lifts):
                    lift = measured.lifts[ray]
                    px, py, pz = px + lift * nx[row], py + lift * ny[row], pz + lift * nz[row]
                    dx, dy, dz = px - start[0], py - start[1], pz - start[2]
                    reach = np.sqrt(dx * dx + dy * dy + dz * dz)
                distance_noisy[row], x_noisy[row], y_noisy[row], z_noisy[row] = reach, px, py, pz
                row += 1


@compiled
def fill_echoes(
    apart: Floats, gap: float, choice: int, distances: Floats, nearest: NDArray[np.intp]
) -> None:
    """Group the hits of each beam's rays into echoes, and choose one echo of each beam.

    Parameters
    ----------
    apart
        Distances of the rays' hits, (beams, rays), m; inf for a ray that hits nothing.
    gap
        Greatest difference between successive distances of an echo, m.
    choice
        Index in `ECHOES`.
    distances
        Receives the mean distance of each chosen echo, (beams,), m; inf for a beam without a hit.
    nearest
        Receives the index of the ray of this echo whose distance is nearest to the mean, (beams,).
    """
    beams, rays = apart.shape
    order, reach = np.empty(rays, np.intp), np.empty(rays)
    for beam in range(beams):
        hits = 0
        for ray in range(rays):
            if apart[beam, ray] < np.inf:
                place = hits
                while place > 0 and reach[place - 1] > apart[beam, ray]:
                    reach[place], order[place] = reach[place - 1], order[place - 1]
                    place -= 1
                reach[place], order[place] = apart[beam, ray], ray
                hits += 1
        distances[beam], nearest[beam] = np.inf, 0
        first, most, total = 0, 0, 0.0
        for place in range(hits):
            total += reach[place]
            if place + 1 < hits and not (choice != 3 and reach[place + 1] - reach[place] > gap):
                continue
            count = place + 1 - first
            if most == 0 or choice == 2 or (choice == 1 and count > most):
                most, mean = count, total / count
                middle = first
                for other in range(first + 1, place + 1):
                    if abs(reach[other] - mean) < abs(reach[middle] - mean):
                        middle = other
                distances[beam], nearest[beam] = mean, order[middle]
            first, total = place + 1, 0.0
