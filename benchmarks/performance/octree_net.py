"""Bytes and seconds of the learned octree coder beside gpcc, which decodes to the same points.

python -m benchmarks.performance.octree_net WEIGHTS cloud.ply [more.ply ...] [--rates r1 r4 r8]
"""

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from puckbench.codecs.registry import open_codec
from puckbench.io.clouds import read_cloud


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = call()
    return result, time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", help="a shipped set, a file or a folder")
    parser.add_argument("clouds", type=Path, nargs="+")
    parser.add_argument("--rates", nargs="+", default=["r1", "r2", "r4", "r8"])
    options = parser.parse_args()
    net = open_codec("sparse_octree_net", {"options": {"weights": options.weights}})
    gpcc = open_codec("gpcc")
    for codec in (net, gpcc):
        codec.load()
    print("cloud rate voxels net_bpp gpcc_bpp change encode_s decode_s load")
    for path in options.clouds:
        points = read_cloud(path).xyz
        for rate in options.rates:
            stream, encode = timed(lambda p=points, r=rate: net.encode(p, r))
            decoded, decode = timed(lambda s=stream: net.decode(s))
            theirs = gpcc.encode(points, rate)
            net_bpp, gpcc_bpp = (8 * len(s) / len(points) for s in (stream, theirs))
            print(
                f"{path.stem} {rate} {len(decoded)} {net_bpp:.4f} {gpcc_bpp:.4f}"
                f" {100 * (net_bpp / gpcc_bpp - 1):+.1f}% {encode:.2f} {decode:.2f}"
                f" {os.getloadavg()[0]:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
