"""PCGCv2 beside G-PCC's octree and trisoup, on the curves of one source and on dense objects.

    python -m benchmarks.claims.dense [--objects 8] [--side 256] [--weights FOLDER]

First the ratio of bits at equal D1 and D2 of each cloud of the published curves of SparsePCGC's
repository, which holds PCGCv2 and both modes of G-PCC of the same clouds. Then PCGCv2+ and, with
its authors' WEIGHTS, PCGCv2 as published on generated objects: every voxel that the surface
touches on a grid of 256 a side, as of a scan by many cameras, and a tenth of these voxels.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
import pandas as pd
from benchmarks.claims.scenes import bd_ratios, opened, report

import puckbench
from pointkit.geometry.cloud import PointCloud
from pointkit.seeding import generator
from puckbench.geometry.normals import estimate_normals
from puckbench.published_sources.registry import source_named
from puckbench.geometry.sampling import sample_surface
from puckbench.geometry.scaling import cube_scaling
from virtual_lidar import make_object

SOURCE = "sparsepcgc"
TESTED, ANCHORS = "PCGCv2", ("G-PCC octree", "G-PCC trisoup")
QUALITIES = ("d1_psnr", "d2_psnr")
OBJECTS = (
    *("airplane_02", "bottle_02", "car_02", "chair_02"),
    *("cup_02", "gear_02", "guitar_02", "vase_02"),
)
POINTS_PER_VOXEL = 12
SPARSE = 0.1
"""Share of the voxels that a sparse object keeps."""


def published() -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield each cloud of the source, with the points of its curves as `compare` has them."""
    rows = source_named(SOURCE).rows
    rows = rows[rows["codec"].isin((TESTED, *ANCHORS)) & rows["measure"].isin(QUALITIES)]
    for cloud, part in rows.groupby("cloud", sort=False):
        if {TESTED, ANCHORS[0]} <= set(part["codec"]):
            wide = part.pivot_table(
                index=["codec", "rate", "bpp"], columns="measure", values="value"
            )
            yield str(cloud), wide.reset_index()


def voxelised(name: str, side: int, share: float) -> PointCloud:
    """Return the voxels that an object's surface touches on a grid, or a share of them at random."""
    random = generator(1, "claims", name)
    points = sample_surface(make_object(name, seed=1), POINTS_PER_VOXEL * side * side, random).xyz
    scaled = cube_scaling(points).apply(points) * (side - 1) / 1023
    voxels = np.unique(np.rint(scaled), axis=0)
    kept = random.permutation(len(voxels))[: round(share * len(voxels))]
    chosen = voxels[np.sort(kept)]
    return PointCloud(chosen, normals=estimate_normals(chosen), about={"size": side})


def by_anchor(parts: list[tuple[str, pd.DataFrame]], tested: str, anchor: str, title: str) -> None:
    for quality in QUALITIES:
        found: dict[str, list[float]] = {tested: []}
        for cloud, table in parts:
            pair = table[table["codec"].isin((tested, anchor))]
            ratios = bd_ratios(pair, anchor, [quality])["ratio"]
            print(f"  {cloud}, {quality}: {', '.join(f'{ratio:.3f}' for ratio in ratios)}")
            found[tested] += list(ratios)
        report(f"{title}: bits relative to {anchor}, equal {quality}", found)


def at_points_of(parts: list[tuple[str, pd.DataFrame]], anchor: str, quality: str) -> None:
    """Report the ratio of bits at each point of an anchor whose curve shares too little for a BD-rate.

    Bits are interpolated along the tested curve as the logarithm over the quality.
    """
    found: dict[str, list[float]] = {}
    for _, table in parts:
        curve = table[table["codec"] == TESTED].sort_values(quality)
        points = table[table["codec"] == anchor].sort_values(quality)
        for number, (bits, value) in enumerate(zip(points["bpp"], points[quality], strict=True)):
            if curve[quality].iloc[0] <= value <= curve[quality].iloc[-1]:
                log_bits = np.interp(value, curve[quality], np.log(curve["bpp"]))
                found.setdefault(f"point {number + 1}", []).append(np.exp(log_bits) / bits)
    report(f"{SOURCE}: bits of {TESTED} relative to points of {anchor}, equal {quality}", found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=int, default=len(OBJECTS))
    parser.add_argument("--side", type=int, default=256)
    parser.add_argument("--weights")
    options = parser.parse_args()
    curves = list(published())
    for anchor in ANCHORS:
        by_anchor(curves, TESTED, anchor, SOURCE)
    for quality in QUALITIES:
        at_points_of(curves, ANCHORS[1], quality)
    changes: dict[str, dict[str, object]] = {"pcgcv2": {"options": {"weights": options.weights}}}
    learned = ["pcgcv2_plus", *(["pcgcv2"] if options.weights else [])]
    codecs = opened("gpcc_dyadic", *learned, **changes)
    for share, title in ((1.0, "dense objects"), (SPARSE, "sparse objects")):
        names = OBJECTS[: options.objects]
        clouds = [(name, voxelised(name, options.side, share)) for name in names]
        for name, cloud in clouds:
            print(f"  {name}: {len(cloud):,} voxels")
        tables = [(name, puckbench.compare(cloud, codecs)) for name, cloud in clouds]
        points = pd.concat([table for _, table in tables])
        columns = ["bpp", *QUALITIES]
        print(points.groupby(["codec", "rate"], sort=False)[columns].mean().round(3).to_string())
        for name in learned:
            by_anchor(tables, name, "gpcc_dyadic", title)


if __name__ == "__main__":
    main()
