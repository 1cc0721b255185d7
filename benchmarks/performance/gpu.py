"""Learned codecs on a CUDA device beside the CPU: seconds, bytes, and decoding on the other side.

python -m benchmarks.performance.gpu [cloud.ply ...] [--codecs pcgcv1_plus ...] [--repeats 3]

Without clouds it codes a sampled object and a scanned room, both scaled to 1024. For each codec
and three of its rates it codes on either side, decodes either stream on either side, and prints
medians of seconds. The last column says what the two sides make of one stream: the same points, or
how many points in a hundred of the CPU's the device has too. Codecs without a `device` are refused.
Where PyTorch finds no CUDA device it says so in one line and ends with status 2.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from benchmarks.clouds import sampled_object, scanned_room

from puckbench.codecs.base import Codec
from puckbench.codecs.registry import open_codec
from puckbench.core.measurement import measured
from puckbench.geometry.cloud import Floats
from puckbench.io.clouds import read_cloud
from puckbench.learned.device import why_not

SHIPPED = ("pcgcv1_plus", "pcgcv2_plus", "pcgcv2_plus_rooms", "sparse_octree_net")
HEADS = (
    *("codec", "cloud", "rate", "bytes", "there", "encode_s", "there", "decode_s", "there"),
    *("stream_of_cpu", "stream_of_cuda"),
)


def opened(name: str, device: str) -> Codec:
    """A codec whose network is on a device, loaded."""
    codec = open_codec(name, {"options": {"device": device}})
    codec.load()
    return codec


def lines(
    here: Codec, there: Codec, cloud: str, points: Floats, repeats: int
) -> Iterator[list[str]]:
    """A line for each of three rates, as `HEADS` says, of codecs that differ in their device."""
    names = list(here.rates)
    for rate in dict.fromkeys((names[0], names[len(names) // 2], names[-1])):
        made = [measured(lambda c=c, r=rate: c.encode(points, r), repeats) for c in (here, there)]
        read = [
            [measured(lambda c=c, m=m: c.decode(m.result), repeats) for c in (here, there)]
            for m in made
        ]
        yield [
            *(here.name, cloud, rate, *(str(len(m.result)) for m in made)),
            *(f"{m.seconds:.3f}" for m in (*made, *read[0])),
            *(agreement(one.result, other.result) for one, other in read),
        ]


def agreement(one: Floats, other: Floats) -> str:
    """What two decoded clouds have in common."""
    found = [{tuple(row) for row in np.unique(cloud, axis=0)} for cloud in (one, other)]
    if found[0] == found[1]:
        return "same"
    return f"{100 * len(found[0] & found[1]) / max(1, len(found[0])):.2f}%"


def clouds_of(files: Sequence[Path]) -> dict[str, Floats]:
    """The clouds to code, by name."""
    if files:
        return {path.stem: read_cloud(path).xyz for path in files}
    return {
        "chair_01": sampled_object(100_000),
        "office_1": scanned_room("vlp16_divergence", azimuth_step_deg=0.9),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clouds", type=Path, nargs="*", help="scaled to 1024 (puckbench prepare)")
    parser.add_argument("--codecs", nargs="+", default=SHIPPED)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    if reason := why_not("cuda"):
        print(reason, file=sys.stderr)
        raise SystemExit(2)
    import torch

    print(f"{torch.cuda.get_device_name()}, torch {torch.__version__}")
    print(*HEADS)
    clouds = clouds_of(options.clouds)
    for name in options.codecs:
        here, there = opened(name, "cpu"), opened(name, "cuda")
        for cloud, points in clouds.items():
            for line in lines(here, there, cloud, points, options.repeats):
                print(*line, flush=True)


if __name__ == "__main__":
    main()
