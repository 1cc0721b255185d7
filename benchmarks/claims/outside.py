"""`primitives` beside G-PCC on objects that are not made of the codec's own surfaces.

    python -m benchmarks.claims.outside CAPOD [--objects 8] [--points 50000]

CAPOD is the folder of the Canonically Posed 3D Objects Dataset (`puckbench data capod`): humans,
animals, plants and tools. Of each class the first object is sampled. Printed are bits relative to
G-PCC's octree at equal D1 and D2 of each object, means by rate, and processor time of encoding.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd
from benchmarks.claims.scenes import bd_ratios, opened, report

import puckbench
from pointkit.seeding import generator
from puckbench.geometry.sampling import sample_surface
from puckbench.scene_sets.registry import open_scene_set

ANCHOR, TESTED = "gpcc", "primitives"
QUALITIES = ("d1_psnr", "d2_psnr")
OBJECTS_OF_CLASS = 12
SCALES = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("capod", type=Path)
    parser.add_argument("--objects", type=int, default=8)
    parser.add_argument("--points", type=int, default=50_000)
    options = parser.parse_args()
    rates = {f"s{scale:.3g}": {"scale": scale} for scale in SCALES}
    codecs = opened(ANCHOR, TESTED, gpcc={"rates": rates})
    objects = open_scene_set("capod", {"path": str(options.capod)})
    tables, ratios = [], []
    for name in objects.names()[::OBJECTS_OF_CLASS][: options.objects]:
        scene = objects.load(name)
        assert scene.mesh is not None
        cloud = sample_surface(scene.mesh, options.points, generator(1, "claims", name))
        tables.append(puckbench.compare(puckbench.prepare(cloud), codecs))
        ratios.append(bd_ratios(tables[-1], ANCHOR, QUALITIES).assign(cloud=scene.group))
        print(ratios[-1].round(3).to_string(index=False, header=False), flush=True)
    columns = ["bpp", *QUALITIES, "encode_cpu_s"]
    points = pd.concat(tables)
    shown = [name for name in columns if name in points]
    print(points.groupby(["codec", "rate"], sort=False)[shown].mean().round(3).to_string())
    for quality, rows in pd.concat(ratios).groupby("quality"):
        report(f"objects: bits relative to {ANCHOR}, equal {quality}", {TESTED: rows["ratio"]})


if __name__ == "__main__":
    main()
