"""How well the codec `primitives` finds the planes of generated rooms, against their labels.

    python benchmarks/primitives_recovery.py [--rooms office_1 ...] [--rates r3 r5] [--step 0.1]

One line a room and rate: bpp, precision and recall of planes, the share of points that are given
their own plane, medians over the matched of angle (degrees) and residual (mm), planes and found.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import primitives_rate_distortion as rd
from puckbench.codecs.registry import open_codec
from puckbench.metrics.primitives import in_metres
from puckbench.metrics.recovery import Segmentation, decoded_segmentation, recovery


def planes(name: str, rate: str, options: argparse.Namespace) -> tuple[float, dict[str, Any]]:
    """Bits per point, and what is said of the planes of one room."""
    found = rd.room(name, options)
    codec = open_codec("primitives")
    stream = codec.encode(found.scan.xyz, rate)
    surface = codec.decode_mesh(stream)
    mesh = rd.scene_of(name, options.captured, options.furniture).mesh
    assert mesh is not None
    assert mesh.labels is not None
    assert surface.labels is not None
    assert found.visible.labels is not None
    scale, offset = found.scan.about["scale"], np.asarray(found.scan.about["offset"])

    moved = tuple(in_metres(one, scale, offset) for one in surface.labels.primitives)
    placed = replace(surface, vertices=found.scan.to_metres(surface.vertices))
    points = found.scan.to_metres(found.visible.xyz)
    own = decoded_segmentation(placed, replace(surface.labels, primitives=moved), points)
    true = Segmentation(found.visible.labels.astype(np.int64), mesh.labels.primitives)
    rows = recovery(true, own, points)
    return 8 * len(stream) / len(found.scan), next(row for row in rows if row["kind"] == "plane")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captured", type=Path, default=Path("data/rooms_quest"))
    parser.add_argument("--furniture", type=Path, default=Path("data/sweethome3d"))
    parser.add_argument("--rooms", nargs="+", default=["office_1", "storage_1"])
    parser.add_argument("--rates", nargs="+", default=["r3", "r5", "r7"])
    parser.add_argument("--errors", default="vlp16_divergence")
    parser.add_argument("--step", type=float, default=0.1)
    parser.add_argument("--cache", type=Path, default=Path("results/primitives_benchmark"))
    options = parser.parse_args()
    for name in options.rooms:
        for rate in options.rates:
            bpp, row = planes(name, rate, options)
            shares = f"{row['precision']:.2f} | {row['recall']:.2f} | {row['label_accuracy']:.0%}"
            medians = f"{row['angle_deg']:.1f} | {1000 * row['residual_m']:.1f}"
            counts = f"{row['true']}, {row['found']}"
            print(f"| {name} | {rate} | {bpp:.3f} | {shares} | {medians} | {counts} |", flush=True)


if __name__ == "__main__":
    main()
