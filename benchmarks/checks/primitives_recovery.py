"""Precision and recall of planes in generated rooms: of codec `primitives` and of other detectors.

    python -m benchmarks.checks.primitives_recovery [--rooms office_1 ...] [--rates r3 r4]
        [--step 0.1]
        [--detectors]

One line a room and rate: bpp, precision and recall of planes, the share of points that are given
their own plane, medians over the matched of angle (degrees) and residual (mm), planes and found.
With `--detectors` also, on the same noisy points: Araujo and Oliveira's planar patches (Open3D's),
RANSAC plane by plane with connected inliers, and regions grown over normals of the codec's smoothed
samples; their planes are those of least squares through the points that they gave to each.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmarks.ablations import primitives_rate_distortion as rd
from numpy.typing import NDArray

from puckbench.codecs.registry import open_codec
from puckbench.geometry.mesh import Primitive
from puckbench.geometry.ransac import least_squares_plane
from puckbench.metrics.recovery import (
    FREEFORM,
    LEAST_SHARE,
    Segmentation,
    decoded_in_metres,
    recovery,
)
from puckbench.primitives.preparation import prepare
from puckbench.primitives.settings import parse_settings

Ints = NDArray[np.int64]

_THICK_M = 0.03
"""Distance from a plane within which points are a detector's inliers: two of a VLP-16's sigmas."""
_APART_M = 0.1
_ALIKE_DEG = 5.0
_MOST_PLANES = 80


class Scanned:
    """A room's scan, and where its rays truly met the surface, with the labels there."""

    def __init__(self, name: str, options: argparse.Namespace) -> None:
        """Scan the room, or take it from the cache."""
        found = rd.room(name, options)
        mesh = rd.scene_of(name, options.captured, options.furniture).mesh
        assert mesh is not None
        assert mesh.labels is not None
        assert found.visible.labels is not None
        self.scan = found.scan
        self.visible = replace(found.visible, about=found.scan.about)
        numbers = found.visible.labels.astype(np.int64)
        self.true = Segmentation(numbers, mesh.labels.primitives)

    def line(self, found: Segmentation) -> str:
        """The measures of the planes found, as text."""
        rows = recovery(self.true, found, self.visible.to_metres(self.visible.xyz))
        row = next(row for row in rows if row["kind"] == "plane")
        shares = f"{row['precision']:.2f} | {row['recall']:.2f} | {row['label_accuracy']:.0%}"
        medians = f"{row['angle_deg']:.1f} | {1000 * row['residual_m']:.1f}"
        return f"{shares} | {medians} | {row['true']}, {row['found']}"


def decoded(room: Scanned, rate: str) -> tuple[float, Segmentation]:
    """Bits per point of the codec, and its segments."""
    codec = open_codec("primitives")
    stream = codec.encode(room.scan.xyz, rate)
    own = decoded_in_metres(codec.decode_mesh(stream), room.visible)
    return 8 * len(stream) / len(room.scan), own


def patches(room: Scanned) -> Ints:
    """Araujo and Oliveira (2020): the nearest of the patches whose box a point lies in, or -1."""
    import open3d as o3d

    xyz = room.scan.to_metres(room.scan.xyz)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(30))
    numbers, nearest = np.full(len(xyz), -1), np.full(len(xyz), np.inf)
    for k, box in enumerate(cloud.detect_planar_patches()):
        at = np.abs((xyz - box.center) @ np.asarray(box.R))
        inside = (at <= np.maximum(np.asarray(box.extent) / 2, _THICK_M)).all(axis=1)
        rows = np.flatnonzero(inside & (at[:, 2] < nearest))
        numbers[rows], nearest[rows] = k, at[rows, 2]
    return numbers


def ransac(room: Scanned) -> Ints:
    """The plane with the most inliers, its connected parts; then again among the points left."""
    import open3d as o3d

    xyz = room.scan.to_metres(room.scan.xyz)
    o3d.utility.random.seed(0)
    least = LEAST_SHARE * len(xyz)
    numbers, left, count = np.full(len(xyz), -1), np.arange(len(xyz)), 0
    for _ in range(_MOST_PLANES):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz[left]))
        _, inliers = cloud.segment_plane(_THICK_M, 3, 1000)
        if len(inliers) < least:
            break
        parts = np.asarray(cloud.select_by_index(inliers).cluster_dbscan(_APART_M, 5))
        for part in np.flatnonzero(np.bincount(parts[parts >= 0]) >= least):
            numbers[left[np.asarray(inliers)[parts == part]]] = count
            count += 1
        left = np.delete(left, inliers)
    return numbers


def growing(room: Scanned) -> Ints:
    """Parts of the graph of near smoothed samples with like normals."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    cloud = prepare(room.scan.xyz, parse_settings(open_codec("primitives").rates["r4"]))
    xyz, normals = cloud.surface.xyz, cloud.surface.normals
    near = cKDTree(xyz).query(xyz, 9)[1]
    a, b = np.repeat(near[:, 0], 8), near[:, 1:].ravel()
    off = np.abs(((xyz[b] - xyz[a]) * normals[a]).sum(axis=1)) * cloud.unit
    alike = np.abs((normals[a] * normals[b]).sum(axis=1)) > np.cos(np.radians(_ALIKE_DEG))
    kept = alike & (off / room.scan.about["scale"] < _THICK_M)
    graph = coo_matrix((np.ones(kept.sum()), (a[kept], b[kept])), shape=(len(xyz), len(xyz)))
    part = connected_components(graph, directed=False)[1]
    return np.asarray(part[cKDTree(xyz).query(cloud.in_units(room.scan.xyz))[1]])


DETECTORS: dict[str, Callable[[Scanned], Ints]] = {
    "Araujo and Oliveira": patches,
    "RANSAC": ransac,
    "regions grown": growing,
}


def fitted(room: Scanned, numbers: Ints) -> Segmentation:
    """Planes of least squares through the noisy points of each number; -1 and few are nothing."""
    xyz = room.scan.to_metres(room.scan.xyz)
    planes: list[Primitive] = []
    own = np.full(len(numbers), -1)
    counts = np.bincount(numbers[numbers >= 0])
    for k in np.flatnonzero(counts >= LEAST_SHARE * len(xyz)):
        rows = numbers == k
        plane = least_squares_plane(xyz[rows])
        own[rows] = len(planes)
        parameters = {"normal": plane.normal.tolist(), "offset": float(plane.offset)}
        planes.append(Primitive("plane", parameters))
    own[own < 0] = len(planes)
    return Segmentation(own, [*planes, Primitive(FREEFORM, {})])


def lines(name: str, options: argparse.Namespace) -> Iterator[str]:
    """The table's lines of a room."""
    room = Scanned(name, options)
    for rate in options.rates:
        bpp, own = decoded(room, rate)
        yield f"| {name} | {rate} | {bpp:.3f} | {room.line(own)} |"
    for label, detect in DETECTORS.items() if options.detectors else ():
        yield f"| {name} | {label} | | {room.line(fitted(room, detect(room)))} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captured", type=Path, default=Path("data/rooms_quest"))
    parser.add_argument("--furniture", type=Path, default=Path("data/sweethome3d"))
    parser.add_argument("--rooms", nargs="+", default=["office_1", "storage_1"])
    parser.add_argument("--rates", nargs="+", default=["r3", "r4", "r5"])
    parser.add_argument("--errors", default="vlp16_divergence")
    parser.add_argument("--step", type=float, default=0.1)
    parser.add_argument("--cache", type=Path, default=Path("results/primitives_benchmark"))
    parser.add_argument("--detectors", action="store_true")
    options = parser.parse_args()
    for name in options.rooms:
        for line in lines(name, options):
            print(line, flush=True)


if __name__ == "__main__":
    main()
