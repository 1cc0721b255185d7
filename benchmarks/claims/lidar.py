"""Learned codecs for LiDAR beside G-PCC with and without the modes for sensors.

    python -m benchmarks.claims.lidar [--scenes 8] [--step-deg DEGREES] [--reno WEIGHTS]

Anchor is G-PCC's octree with `angularEnabled: 0`, as papers run it. Tested are the angular octree,
predictive geometry and, with the authors' weights, RENO. Each generated street is a scene, scanned
by a virtual HDL-64E. Printed are ratios of bits to the anchor's at equal D1 and D2, and bits per
point by rate.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import pandas as pd
from benchmarks.claims.scenes import (
    bd_ratios,
    opened,
    report,
    street_names,
    turn_of,
)

import puckbench
from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import Codec

ANCHOR = "gpcc_no_sensor"
STEPS = [f"{step}mm" for step in (64, 32, 16, 8, 4)]
QUALITIES = ("d1_psnr", "d2_psnr")
PEAK_M = 59.7
"""Peak of RENO's PSNRs of KITTI."""


def codecs(reno: str | None) -> list[Codec]:
    octrees = (ANCHOR, "gpcc_angular")
    changes: dict[str, dict[str, object]] = {name: {"metric_rates": STEPS} for name in octrees}
    names = [*octrees, "gpcc_predictive"]
    if reno:
        rates = {step: {"posq": int(step[:-2])} for step in STEPS[:-1]}
        changes["reno"] = {"options": {"weights": reno}, "rates": rates}
        names.append("reno")
    return opened(*names, **changes)


def measured(cloud: PointCloud, tested: list[Codec]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the points of all curves, and the ratios of bits to the anchor's."""
    table = puckbench.compare(cloud, tested, peak=PEAK_M)
    return table, bd_ratios(table, ANCHOR, QUALITIES)


def streets(count: int, sensor: str, step_deg: float | None) -> Iterator[PointCloud]:
    for name in street_names(count):
        yield turn_of(name, sensor, step_deg)


def show(title: str, parts: list[tuple[pd.DataFrame, pd.DataFrame]]) -> None:
    """Print bits and PSNRs by rate, and the ratios of the scenes."""
    points = pd.concat([part[0] for part in parts])
    means = points.groupby(["codec", "rate"], sort=False)[["bpp", *QUALITIES]].mean()
    print(f"\n{title}: means of {len(parts)} clouds\n{means.round(3).to_string()}")
    ratios = pd.concat([part[1] for part in parts])
    for quality, rows in ratios.groupby("quality"):
        by_codec = {str(name): list(part["ratio"]) for name, part in rows.groupby("codec")}
        report(f"{title}: bits relative to {ANCHOR}, equal {quality}", by_codec)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--sensor", default="hdl64e_s2")
    parser.add_argument("--step-deg", type=float)
    parser.add_argument("--reno", metavar="WEIGHTS")
    options = parser.parse_args()
    tested = codecs(options.reno)
    made = streets(options.scenes, options.sensor, options.step_deg)
    show(f"streets, {options.sensor}", [measured(turn, tested) for turn in made])


if __name__ == "__main__":
    main()
