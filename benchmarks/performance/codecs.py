"""Bits, time, memory and error of codecs on one cloud, side by side.

    python -m benchmarks.performance.codecs CLOUD --codecs NAME ... [--rates RATE ...]
        [--repeats 3] [--entry 'YAML'] [--points N]

CLOUD is a file, of a recording the first whole turn, or `room`, `object` (scaled to 1023) or `turn`
(metres, with the returns of a virtual VLP-16), which are generated with about N points. `--entry`
changes codecs as `codecs` of a configuration does. Every codec and rate takes its turn in every
repeat, and the least time of the repeats counts, because other work on the machine only adds. Times
are of arrays in memory, after weights are loaded and loops compiled: wall clock, and processor time
in brackets. Memory is the peak above what was resident before the call. The last two rows are
compressed coordinates in single precision, as PointCloud2 has them.
"""

from __future__ import annotations

import argparse
import lzma
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from benchmarks.clouds import sampled_object, scanned_room
from benchmarks.performance.rows import Inputs, Row
from benchmarks.turns import virtual_returns

import puckbench
from cloud_files.clouds import read_cloud
from pointkit.coding.zstandard import compressed
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.measurement import measured
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import cost_of, decoded, encoded
from puckbench.codecs.rates import rates_of
from puckbench.codecs.registry import open_codec
from puckbench.metrics.geometry import distortion

T = TypeVar("T")
MEASURED = {
    "room": {
        "draco": "r7",
        "gpcc": "r8",  # the same grid
        "primitives": "r4",
        "pcgcv2_plus": "r7",
        "sparse_octree_net": "r8",
    },
    "object": {"pcgcv2_plus": "r7", "pcgcv1_plus": "r6"},
}
"""Rates that `measure` codes, by cloud and codec."""
POINTS = {"room": 1_152_000, "object": 100_000}
MOST_S = {
    ("pcgcv2_plus", "encode"): 2,
    ("pcgcv2_plus", "decode"): 5,
    ("sparse_octree_net", "encode"): 2.3,
    ("sparse_octree_net", "decode"): 2.3,
}
"""Aims for a room; 2.3 s are 2 s a million points."""
SCALED = {"size": 1024}
RECORDINGS = (".bag", ".db3", ".mcap", ".pcap", ".pcapng", ".puck")


@dataclass
class Case:
    codec: Codec
    rate: str
    seconds: Floats = field(default_factory=lambda: np.full((2, 2), np.inf))
    """Encoding and decoding; by wall clock, and of the processor."""
    peak_mib: float = 0.0
    stream: bytes = b""
    error: float = 0.0

    def run(self, cloud: PointCloud) -> None:
        self.stream, *encoding = self._timed(lambda: encoded(self.codec, cloud, self.rate))
        result, *decoding = self._timed(lambda: decoded(self.codec, self.stream))
        for column, pair in enumerate(zip(encoding, decoding, strict=True)):
            self.seconds[column] = np.minimum(self.seconds[column], pair)
        if not self.error:
            self.error = float(np.sqrt(distortion(PointCloud(cloud.xyz), result.xyz)["d1_mse"]))

    def values(self, points: int) -> dict[str, tuple[float, str]]:
        """Values and units, by what they are of."""
        encode_s, decode_s = self.seconds[0].tolist()  # wall clock
        bits = 8 * len(self.stream) / points
        return {
            "encode": (encode_s, "s"),
            "decode": (decode_s, "s"),
            "memory": (self.peak_mib, "MiB"),
            "size": (bits, "bits per point"),
        }

    def _timed(self, call: Callable[[], T]) -> tuple[T, float, float]:
        before = time.process_time()
        result = measured(call, whole=partial(cost_of, self.codec))
        self.peak_mib = max(self.peak_mib, result.peak_mib)
        return result.result, result.seconds, time.process_time() - before


def opened_cloud(name: str, points: int) -> PointCloud:
    if name == "room":
        return PointCloud(scanned_room("vlp16_divergence", 0.1 * 1_152_000 / points), about=SCALED)
    if name == "object":
        return PointCloud(sampled_object(points), about=SCALED)
    if name == "turn":
        returns = virtual_returns("vlp16", max(1, round(points / 28_800)))
        return PointCloud(returns.points(), returns=returns)
    if Path(name).suffix in RECORDINGS:
        return next(puckbench.turns(name))
    return read_cloud(Path(name))


def measure(inputs: Inputs) -> Iterator[Row]:
    repeats = inputs.repeats(3)
    for name, rates in MEASURED.items():
        cloud = opened_cloud(name, 20_000 if inputs.is_trial else POINTS[name])
        cases = {codec: Case(loaded(codec), rate) for codec, rate in rates.items()}
        for _ in range(repeats):
            for case in cases.values():
                case.run(cloud)
        for codec, case in cases.items():
            draco = cases["draco"].values(len(cloud)) if codec == "gpcc" else {}
            for what, (value, unit) in case.values(len(cloud)).items():
                rival = ("Draco", draco[what][0]) if draco else ("", None)
                most = MOST_S.get((codec, what)) if name == "room" else None
                where = f"{name}, {len(cloud):,} points, {codec} {case.rate}: {what}"
                yield Row(where, value, unit, rival[0], rival[1], most, repeats=repeats)


def loaded(name: str, entry: Any = None) -> Codec:
    codec = open_codec(name, entry)
    codec.load()
    return codec


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cloud")
    parser.add_argument("--codecs", nargs="+", required=True)
    parser.add_argument("--rates", nargs="+")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--entry", type=yaml.safe_load, default={})
    parser.add_argument("--points", type=int, default=1_152_000)
    options = parser.parse_args()
    cloud = opened_cloud(options.cloud, options.points)
    frame = "metric" if cloud.returns is not None else cloud.frame
    cases = []
    for name in options.codecs:
        codec = loaded(name, options.entry.get(name))
        cases += [Case(codec, rate) for rate in options.rates or rates_of(codec, frame)]
    for _ in range(options.repeats):
        for case in cases:
            case.run(cloud)
    print(f"{len(cloud):,} points\n")
    print("| codec | rate | bits per point | D1, RMS | encode s | decode s | MiB |")
    print("|---|---|---|---|---|---|---|")
    for case in cases:
        bits = 8 * len(case.stream) / len(cloud)
        times = [f"{w:.3f} ({c:.3f})" for w, c in case.seconds.T.tolist()]
        print(
            f"| {case.codec.name} | {case.rate} | {bits:.4f} | {case.error:.4g} "
            f"| {' | '.join(times)} | {case.peak_mib:.0f} |"
        )
    raw = cloud.xyz.astype("<f4").tobytes()
    xz = lzma.compress(raw, preset=9 | lzma.PRESET_EXTREME)
    for name, stream in (("zstd -19", compressed(raw)), ("xz -9e", xz)):
        print(f"| {name} |  | {8 * len(stream) / len(cloud):.4f} |  |  |  |  |")


if __name__ == "__main__":
    main()
