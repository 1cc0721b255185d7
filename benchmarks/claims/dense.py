"""PCGCv2 beside G-PCC's octree and trisoup, on the published curves of one source.

    python -m benchmarks.claims.dense

Ratios of bits at equal D1 and D2 of each dense cloud of SparsePCGC's repository, which holds the
curves of PCGCv2 and of both modes of G-PCC. Curves of trisoup share too little of PCGCv2's range
for BD-rates, so that its points are compared one by one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
import pandas as pd
from benchmarks.claims.scenes import bd_ratios, report

from puckbench.published_sources.registry import source_named

SOURCE = "sparsepcgc"
TESTED, ANCHORS = "PCGCv2", ("G-PCC octree", "G-PCC trisoup")
QUALITIES = ("d1_psnr", "d2_psnr")


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
    """Report ratios of bits at points of an anchor whose curve shares too little for a BD-rate.

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
    argparse.ArgumentParser(description=__doc__).parse_args()
    curves = list(published())
    for anchor in ANCHORS:
        by_anchor(curves, TESTED, anchor, SOURCE)
    for quality in QUALITIES:
        at_points_of(curves, ANCHORS[1], quality)


if __name__ == "__main__":
    main()
