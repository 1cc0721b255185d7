"""Pictures of the codec `primitives`: a scan, its primitives coloured, the decode, the error.

    python -m benchmarks.ablations.primitives_pictures OUT.png --cloud living_room [--rate r5]
        [--captured ..]
    python -m benchmarks.ablations.primitives_pictures OUT.png --cloud bottle_01

A room is scanned as in `primitives_rate_distortion`; an object of `embedded_objects` is sampled.
Four panels: the cloud and the decode coloured by their distance to the truth (blue: none, red:
eight units and more), the primitives in one colour each, the decode in grey. The ceiling is left
out. Prints bpp and how many planes and round surfaces the stream has.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.ablations import primitives_rate_distortion as rd

from puckbench.codecs.primitives.decoder import read_patches
from puckbench.codecs.primitives.segments import segment_points
from puckbench.codecs.primitives.stream import SurfaceHeader, unpack
from puckbench.codecs.registry import open_codec
from puckbench.core.seeding import generator
from puckbench.datasets.registry import open_scene_set
from puckbench.geometry.closest import closest_surface_points, mesh_in_frame
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.geometry.rendering import render_cloud, three_quarter_view, tile
from puckbench.geometry.sampling import sample_surface
from puckbench.jobs.preparation import prepare

_SIZE = (640, 440)
_FAR = 8.0


def cloud_of(options: argparse.Namespace) -> tuple[Floats, Mesh, float]:
    """Points, the true surface in their frame, and the height above which nothing is drawn."""
    if options.cloud in open_scene_set("embedded_objects", {}).names():
        scene = open_scene_set("embedded_objects", {}).load(options.cloud)
        assert scene.mesh is not None
        sampled = sample_surface(scene.mesh, options.points, generator(1, options.cloud))
        cloud = prepare(sampled)
        frame = (float(cloud.about["scale"]), np.asarray(cloud.about["offset"]))
        return cloud.xyz, mesh_in_frame(scene.mesh, *frame), np.inf
    room = rd.room(options.cloud, options)
    return room.scan.xyz, room.mesh, float(room.scan.xyz[:, 2].max()) - 60


def by_error(points: Floats, truth: Mesh) -> Any:
    """Colours (n, 3) from blue to red by the distance to the truth."""
    vectors = points - closest_surface_points(truth, points).xyz
    share = (np.linalg.norm(vectors, axis=1) / _FAR).clip(0, 1)[:, None]
    return (np.array([60, 110, 190]) * (1 - share) + np.array([225, 60, 40]) * share).astype("u1")


def panels(points: Floats, truth: Mesh, top: float, stream: bytes) -> list[Any]:
    """The four pictures."""
    header, bits = unpack(stream)
    assert isinstance(header, SurfaceHeader), "the stream holds voxels: take a lower rate"
    decoded, names = segment_points(read_patches(header, bits))
    view = three_quarter_view(np.stack([points.min(axis=0), points.max(axis=0)]))
    palette = (generator(3, "palette").random((names.max() + 1, 3)) * 170 + 60).astype("u1")
    points, kept = points[points[:, 2] < top], decoded[:, 2] < top
    decoded, names = decoded[kept], names[kept]
    drawn = [(points, by_error(points, truth)), (decoded, palette[names])]
    drawn += [(decoded, None), (decoded, by_error(decoded, truth))]
    return [render_cloud(xyz, colours, view, _SIZE, radius=2) for xyz, colours in drawn]


def main() -> None:
    """Write the picture."""
    from PIL import Image

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cloud", default="living_room")
    parser.add_argument("--rate", default="r5")
    parser.add_argument("--points", type=int, default=500_000)
    parser.add_argument("--captured", type=Path, default=Path("data/rooms_quest"))
    parser.add_argument("--furniture", type=Path, default=Path("data/sweethome3d"))
    parser.add_argument("--errors", default="vlp16_divergence")
    parser.add_argument("--step", type=float, default=0.1)
    parser.add_argument("--cache", type=Path, default=Path("results/primitives_benchmark"))
    options = parser.parse_args()
    points, truth, top = cloud_of(options)
    stream = open_codec("primitives").encode(points, options.rate)
    header, bits = unpack(stream)
    assert isinstance(header, SurfaceHeader), "the stream holds voxels: take a lower rate"
    patches = read_patches(header, bits)
    planes, rounds = int(patches.leaves.counts[1]), len(patches.rounds)
    print(f"{8 * len(stream) / len(points):.4f} bpp, {planes} planes, {rounds} round surfaces")
    picture = Image.fromarray(tile(panels(points, truth, top, stream), 2))
    picture.quantize(128).save(options.out, optimize=True)


if __name__ == "__main__":
    main()
