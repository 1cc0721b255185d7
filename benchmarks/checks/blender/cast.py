"""Runs inside Blender's Python (package `bpy`): casts given rays at a given mesh, and times it.

    PYTHON_WITH_BPY benchmarks/checks/blender/cast.py SCENE.npz ANSWER.npz REPEATS

`compare.py` writes the scene, starts this and reads the answer. The sensor stands at the origin.
"""

from __future__ import annotations

import math
import random
import sys
import time
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Vector
from mathutils.bvhtree import BVHTree

ORIGIN = Vector((0.0, 0.0, 0.0))
BIAS_SIGMA_M, RAY_SIGMA_M = 0.014, 0.010


def scene_of(vertices: np.ndarray, triangles: np.ndarray) -> tuple[Any, Any]:
    """The mesh alone in a scene; Blender starts with a cube otherwise."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("scanned")
    mesh.from_pydata(vertices.tolist(), [], triangles.tolist())
    scanned = bpy.data.objects.new("scanned", mesh)
    bpy.context.scene.collection.objects.link(scanned)
    bpy.context.view_layer.update()
    return scanned, bpy.context.evaluated_depsgraph_get()


def by_scene(depsgraph: Any, rays: list[Vector], farthest: float) -> list[tuple[bool, Vector]]:
    """Hit or not, and place, of each ray by `Scene.ray_cast`."""
    cast = bpy.context.scene.ray_cast
    return [cast(depsgraph, ORIGIN, ray, distance=farthest)[:2] for ray in rays]


def by_tree(tree: BVHTree, rays: list[Vector], farthest: float) -> list[float | None]:
    """Distance of each ray, or None, by `BVHTree.ray_cast`."""
    return [tree.ray_cast(ORIGIN, ray, farthest)[3] for ray in rays]


def as_blensor_does(tree: BVHTree, angles: list[tuple[float, float]], farthest: float) -> list[Any]:
    """A scan the way BlenSor works: Python for each ray before, and for each return after the cast.

    angles: yaw and pitch of each ray, rad, 16 rays after each other from one column. Rows of a
    timestamp, the angles, two distances and two points.
    """
    rays = []
    for yaw, pitch in angles:
        ray = Vector((0.0, 1.0, 0.0))
        ray.rotate(Euler((pitch, 0.0, yaw)))
        rays.append(ray)
    biases = [random.gauss(0.0, BIAS_SIGMA_M) for _ in range(16)]
    rows = []
    for number, ((yaw, pitch), ray) in enumerate(zip(angles, rays, strict=True)):
        place, _, _, distance = tree.ray_cast(ORIGIN, ray, farthest)
        if distance is None:
            continue
        length = math.sqrt(place[0] ** 2 + place[1] ** 2 + place[2] ** 2)
        noisy = length + biases[number % 16] + random.gauss(0.0, RAY_SIGMA_M)
        unit = [place[0] / length, place[1] / length, place[2] / length]
        moved = Vector((unit[0] * noisy, unit[1] * noisy, unit[2] * noisy))
        rows.append((number // 16 * 5e-5, yaw, pitch, length, noisy, tuple(place), tuple(moved)))
    return rows


def least_time(action: Callable[[], Any], repeats: int) -> tuple[list[float], Any]:
    """The least seconds of `repeats` runs, on the wall and of the processor; the last's answer."""
    times = []
    for _ in range(repeats):
        start, used = time.perf_counter(), time.process_time()
        answer = action()
        times.append((time.perf_counter() - start, time.process_time() - used))
    return np.min(times, axis=0).tolist(), answer


def lengths_of(found: list[tuple[bool, Vector]]) -> np.ndarray:
    """Distances in the accuracy of the places, inf for a miss, (n,)."""
    hit = np.array([struck for struck, _ in found])
    places = np.array([tuple(place) for _, place in found])
    return np.where(hit, np.linalg.norm(places, axis=1), np.inf)


def main() -> None:
    scene_file, answer_file, repeats = sys.argv[1], sys.argv[2], int(sys.argv[3])
    given = np.load(scene_file)
    rays = [Vector(ray) for ray in given["rays"].tolist()]
    farthest = float(given["farthest"])
    scanned, depsgraph = scene_of(given["vertices"], given["triangles"])
    tree = BVHTree.FromObject(scanned, depsgraph)
    by_scene(depsgraph, rays[:1], farthest)
    scene_s, found = least_time(lambda: by_scene(depsgraph, rays, farthest), repeats)
    scene_distances = lengths_of(found)
    tree_s, found = least_time(lambda: by_tree(tree, rays, farthest), repeats)
    tree_distances = np.array([np.inf if reach is None else reach for reach in found])
    del found
    angles = [(float(yaw), float(pitch)) for yaw, pitch in given["angles"]]
    blensor_s, rows = least_time(lambda: as_blensor_does(tree, angles, farthest), 1)
    np.savez(
        answer_file,
        scene=scene_distances,
        tree=tree_distances,
        seconds=[scene_s, tree_s, blensor_s],
        returns=len(rows),
        version=bpy.app.version_string,
    )


main()
