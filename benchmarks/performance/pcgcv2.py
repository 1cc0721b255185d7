"""Time, memory and size of PCGCv2 against the number of voxels, and the arithmetic's bound.

    python -m benchmarks.performance.pcgcv2 WEIGHTS [--rate r7] [--voxels 10000 100000 830000]
        [--repeats 3]

WEIGHTS: a shipped set, a file or a folder. The clouds are rooms: the walls of a box that stands
askew in the grid, and a ball in it, as dense as the grid. Seconds are of `encode` and `decode` on
arrays in memory (rounding, coordinates and entropy coding included), weights loaded and loops
compiled before: wall clock and the processor's own; the least of the repeats counts, since other
work on the machine only adds. The bound is the multiplications and additions of the network over
the speed of this machine's large matrix products, measured alongside. Memory is what a call needs
above what was there.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import torch

from puckbench.codecs.base import Codec
from puckbench.codecs.registry import open_codec
from puckbench.core.measurement import measured
from puckbench.geometry.cloud import Floats
from puckbench.learned.sparse.kernel_map import block_kernel_map
from puckbench.learned.sparse.voxels import OFFSETS, VoxelSet, morton_keys, pyramid

T = TypeVar("T")
ENCODER, DECODER = ((16, 32, 32), (32, 64, 64), (64, 32, 8)), ((8, 64), (64, 32), (32, 16))


def room(voxels: int) -> Floats:
    """Voxels of a room's surfaces, about as many as asked for."""
    side = np.sqrt(voxels / 7.7)
    rng = np.random.default_rng(0)
    box = rng.random((24 * voxels, 3))
    box[np.arange(len(box)), rng.integers(0, 3, len(box))] = rng.integers(0, 2, len(box))
    ball = rng.normal(size=(6 * voxels, 3))
    ball = 0.5 + 0.25 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    points = np.vstack([box * [1.2, 1.0, 0.6], ball * [1.2, 1.0, 0.6]]) * side
    turned, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    points = points @ turned
    return np.unique(np.rint(points - points.min(axis=0)), axis=0)


def block_work(width: int) -> tuple[int, int]:
    """Multiplications of three residual blocks, for each pair of neighbours and each voxel."""
    quarter = width // 4
    near = width * quarter + quarter * 2 * quarter + quarter * quarter
    return 3 * near, 3 * (width * quarter + quarter * 2 * quarter)


def encoder_work(sets: list[VoxelSet]) -> float:
    """Multiplications of the encoder."""
    pairs = [int((voxels.neighbours >= 0).sum()) for voxels in sets]
    total = pairs[0] * 16
    for scale, (width, wider, end) in enumerate(ENCODER):
        near, own = block_work(wider)
        total += len(sets[scale]) * width * wider + pairs[scale + 1] * (near + wider * end)
        total += len(sets[scale + 1]) * own
    return total


def decoder_work(sets: list[VoxelSet]) -> float:
    """Multiplications of the decoder."""
    total = 0
    for parents, (width, wider) in zip(sets[:0:-1], DECODER, strict=True):
        present = (parents.neighbours >= 0).sum(axis=1)
        pairs = sum(int(present[k]) * block_kernel_map().sizes[k] ** 2 for k in range(OFFSETS))
        near, own = block_work(wider)
        total += len(parents) * 8 * (width * wider + own) + pairs * (near + wider**2 + wider)
    return total


def product_speed() -> float:
    """Multiplications and additions a second of a large matrix product, all threads."""
    a, b = torch.rand(2, 2048, 2048)
    seconds = []
    for _ in range(6):
        start = time.perf_counter()
        torch.mm(a, b)
        seconds.append(time.perf_counter() - start)
    return 2 * 2048**3 / min(seconds)


def cost(call: Callable[[], T], repeats: int) -> tuple[T, str]:
    """Result of a call, and its least wall and CPU seconds and largest memory."""
    wall, cpu, peak = np.inf, np.inf, 0.0
    for _ in range(repeats):
        before = time.process_time()
        took = measured(call)
        cpu = min(cpu, time.process_time() - before)
        wall, peak = min(wall, took.seconds), max(peak, took.peak_mib)
    return took.result, f"{wall:.2f} s wall, {cpu:.2f} s CPU, {peak:.0f} MiB"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("weights")
    parser.add_argument("--rate", default="r7")
    parser.add_argument("--voxels", type=int, nargs="+", default=[10_000, 100_000, 830_000])
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    codec = open_codec("pcgcv2_plus", {"options": {"weights": options.weights}})
    codec.load()
    print(f"{torch.get_num_threads()} threads, load {os.getloadavg()[0]:.1f}")
    for voxels in options.voxels:
        report(codec, room(voxels), options)
    print(f"load {os.getloadavg()[0]:.1f}")


def report(codec: Codec, points: Floats, options: argparse.Namespace) -> None:
    """Print what coding a cloud costs and what its arithmetic would."""
    stream, encoding = cost(lambda: codec.encode(points, options.rate), options.repeats)
    _, decoding = cost(lambda: codec.decode(stream), options.repeats)
    sets, _ = pyramid(np.sort(morton_keys(points.astype(np.int64))), 3)
    speed = product_speed()
    print(f"{len(points)} voxels, {8 * len(stream) / len(points):.4f} bpp")
    for name, work, costs in (
        ("encode", 2 * encoder_work(sets), encoding),
        ("decode", 2 * decoder_work(sets), decoding),
    ):
        bound = f"{work / 1e9:.1f} GFLOP, {work / speed:.2f} s at {speed / 1e9:.0f} GFLOP/s"
        print(f"  {name}: {costs}; {bound}")


if __name__ == "__main__":
    main()
