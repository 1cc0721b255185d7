"""Rate and distortion of the primitives codec without each of its parts, by noise and density.

    python -m benchmarks.ablations.primitives_ablations ROOM --captured FOLDER [--rates r3 r4]

Prints, for a scanned room, bpp, CD(plane) to the scan and to the truth: as shipped, with parts of
the codec switched off, with fewer points, and with other noise (bias and ray sigma alike, m).
`voxels always, not moved` is the coder of bitmaps alone: G-PCC's octree of occupied cells.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.ablations import primitives_rate_distortion as rd

from puckbench.codecs.registry import codec_class, open_codec
from puckbench.geometry.closest import mesh_in_frame
from puckbench.geometry.cloud import PointCloud
from puckbench.jobs.preparation import Returns, prepare
from puckbench.lidar.errors import open_error_model
from puckbench.lidar.placement import free_origin
from puckbench.lidar.scan import scan
from puckbench.lidar.sensor import load_sensor
from puckbench.lidar.sweep import open_sweep
from puckbench.primitives import (
    grid_alignment,
    mode_decision,
    preparation,
    smoothing,
    surface_mode,
    voxel_mode,
)
from puckbench.primitives.manhattan_frame import rotation_matrix

SIGMAS_M = (0.0, 0.005, 0.01, 0.02, 0.05)
POINTS = (50_000, 150_000, 500_000, 1_150_000)
PARTS = ("switches", "turned", "points", "noise")
_TURN = (0, 0, 6000)
"""About the vertical by 33 degrees, so that walls do not lie along the cloud's axes."""


@cache
def own_error(found: rd.Room) -> float:
    """CD(plane) of the scan itself to the truth."""
    return rd.errors(found, found.scan.xyz)[1]


def line(label: str, found: rd.Room, rates: list[str], **changes: Any) -> None:
    """Measure the codec with changed parameters of its rates."""
    shipped = codec_class("primitives").rates
    for rate in rates:
        parameters = {**shipped[rate], **changes}
        if changes.get("max_leaf_size") == 0:
            parameters["max_leaf_size"] = parameters["min_leaf_size"]
        codec = open_codec("primitives", {"rates": {rate: parameters}})
        stream = codec.encode(found.scan.xyz, rate)
        to_scan, to_truth, _ = rd.errors(found, codec.decode(stream))
        bpp = 8 * len(stream) / len(found.scan)
        values = f"{bpp:.4f} | {to_scan:.3f} | {to_truth:.3f} | {own_error(found):.3f}"
        print(f"| {label} | {rate} | {values} |", flush=True)


def noisy(options: argparse.Namespace, sigma: float) -> rd.Room:
    """The room scanned with another noise."""
    scene = rd.scene_of(options.room, options.captured, options.furniture)
    assert scene.mesh is not None
    table = scan(
        scene.mesh,
        load_sensor("vlp16"),
        open_sweep({"azimuth_step_deg": options.step}),
        open_error_model("vlp16", {"bias_sigma_m": sigma, "ray_sigma_m": sigma}),
        scene.origin or free_origin(scene.mesh),
        np.random.default_rng(1),
    )
    clean = PointCloud(table.xyz, table.normals)
    returns = Returns(PointCloud(table.xyz_noisy), clean)
    returns = returns if scene.box is None else returns.cropped(scene.box)
    cloud = prepare(returns.cloud)
    frame = (cloud.about["scale"], np.asarray(cloud.about["offset"]))
    return rd.Room(cloud, returns.truth_in_frame_of(cloud), mesh_in_frame(scene.mesh, *frame))


def thinned(found: rd.Room, points: int) -> rd.Room:
    """The room with some of its points, drawn at random."""
    rows = np.sort(np.random.default_rng(0).permutation(len(found.scan))[:points])
    cloud = prepare(found.scan.select(rows), size=0)
    return rd.Room(cloud, found.visible.select(rows), found.mesh)


def turned(found: rd.Room) -> rd.Room:
    """The room turned about the vertical."""
    turn = rotation_matrix(_TURN).T
    scan, visible = (
        PointCloud(cloud.xyz @ turn, cloud.normals @ turn, labels=cloud.labels, about=cloud.about)
        for cloud in (found.scan, found.visible)
    )
    return rd.Room(scan, visible, replace(found.mesh, vertices=found.mesh.vertices @ turn))


@contextmanager
def switched(owner: Any, name: str, function: Any) -> Iterator[None]:
    """Have another function in a module or a class for a while."""
    kept = getattr(owner, name)
    setattr(owner, name, function)
    try:
        yield
    finally:
        setattr(owner, name, kept)


_OWN_AXES = (grid_alignment, "estimate_manhattan_frame", lambda normals: (0, 0, 0))


def ablate(found: rd.Room, rates: list[str]) -> None:
    """Print a line for each part switched off."""
    line("as shipped", found, rates)
    line("no smoothing", found, rates, smoothing_radius=0)
    with switched(preparation, "estimate_noise", lambda points, cell: 0.0):
        line("no model of the noise", found, rates)
    line("no larger leaves", found, rates, max_leaf_size=0)
    with switched(surface_mode, "_EDGE_BITS", 0.0):
        line("occupancy maps without edge costs", found, rates)
    nothing_else = ("surface_is_better_by_product", lambda comparison: False)
    for label, *switches in (
        ("one pass of smoothing", (smoothing, "_PASSES", 1)),
        (
            "no regions: each leaf's own plane",
            (surface_mode, "region_moments", lambda moments, *_: moments),
        ),
        ("axes of the cloud, not of its walls", _OWN_AXES),
        ("one place of the grid", (grid_alignment, "_has_large_leaves", lambda cloud: False)),
        ("no cylinders, spheres, cones", (mode_decision, "detect_surfaces", lambda cloud: ())),
        ("voxels never", (mode_decision._Comparison, "surface_is_better", lambda comparison: True)),
        (
            "voxels always",
            (mode_decision._Comparison, "surface_is_better", lambda comparison: False),
            (mode_decision._Comparison, *nothing_else),
        ),
        (
            "voxels always, not moved",
            (mode_decision._Comparison, "surface_is_better", lambda comparison: False),
            (mode_decision._Comparison, *nothing_else),
            (voxel_mode, "_fit_displacements", lambda *_: None),
        ),
    ):
        with ExitStack() as changed:
            for owner, name, function in switches:
                changed.enter_context(switched(owner, name, function))
            line(label, found, rates)


def main() -> None:
    """Print the rows of the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room")
    parser.add_argument("--captured", type=Path, default=Path("data/rooms_quest"))
    parser.add_argument("--furniture", type=Path, default=Path("data/sweethome3d"))
    parser.add_argument("--rates", nargs="+", default=["r3", "r4"])
    parser.add_argument("--errors", default="vlp16_divergence")
    parser.add_argument("--step", type=float, default=0.1)
    parser.add_argument("--cache", type=Path, default=Path("results/primitives_benchmark"))
    parser.add_argument("--parts", nargs="+", default=PARTS, choices=PARTS)
    options = parser.parse_args()
    found = rd.room(options.room, options)
    if "switches" in options.parts:
        ablate(found, options.rates)
    if "turned" in options.parts:
        line("turned", turned(found), options.rates)
        with switched(*_OWN_AXES):
            line("turned, axes of the cloud", turned(found), options.rates)
    for points in POINTS if "points" in options.parts else ():
        line(f"{points} points", thinned(found, points), options.rates)
    for sigma in SIGMAS_M if "noise" in options.parts else ():
        line(f"sigma {sigma} m", noisy(options, sigma), options.rates)


if __name__ == "__main__":
    main()
