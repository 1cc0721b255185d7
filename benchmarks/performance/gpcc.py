"""Time, memory and size of our G-PCC coder and of the reference software, side by side.

    python -m benchmarks.performance.gpcc TMC3 [--repeats 3] [--profiles minimal ctc defaults]
        [--clean]

A generated office, 1,152,000 returns with the VLP-16's errors, at scales 0.125, 0.5 and 1. TMC3's
seconds are those it prints, wall clock and user time, without its reading and writing of files;
ours are of `encode` and `decode` on arrays in memory, rounding and merging included, compiled
before, wall clock and the processor's time. The two take turns and the least of the repeats counts:
other work on the machine only adds. Memory is TMC3's whole process, and ours above the arrays that
were there before the call.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from benchmarks.clouds import scanned_room

from puckbench.codecs.base import Codec
from puckbench.codecs.external import ExternalCodec
from puckbench.codecs.registry import open_codec
from puckbench.core.measurement import measured
from puckbench.geometry.cloud import Floats

T = TypeVar("T")
RATES = {"a": {"scale": 0.125}, "b": {"scale": 0.5}, "c": {"scale": 1.0}}
COLUMNS = (
    *("profile", "scale", "points", "bytes", "encode, wall s", "decode, wall s"),
    *("encode, CPU s", "decode, CPU s", "memory, MiB"),
)


def printed_seconds(codec: ExternalCodec) -> list[float]:
    """Wall-clock and user seconds that the program says it took."""
    kinds = (r"Processing time \(wall\): (\S+) s", r"^Processing time \(user\): (\S+) s")
    found = [re.search(kind, codec.output, re.MULTILINE) for kind in kinds]
    return [float(match[1]) for match in found if match]


class Turn:
    """One codec's streams, least times (wall, CPU) and largest memory over the repeats."""

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self.seconds = np.full((2, 2), np.inf)  # wall and CPU, encode and decode
        self.peak = 0.0

    def take(self, points: Floats, rate: str) -> None:
        stream = self._timed(0, lambda: self.codec.encode(points, rate))
        self.points = len(self._timed(1, lambda: self.codec.decode(stream)))
        self.bytes = len(stream)

    def _timed(self, which: int, call: Callable[[], T]) -> T:
        found = measured(lambda: with_cpu_seconds(call), outside=self.codec.cost)
        result, cpu = found.result
        seconds = [found.seconds, cpu]
        if isinstance(self.codec, ExternalCodec):
            seconds = printed_seconds(self.codec)
        self.seconds[:, which] = np.minimum(self.seconds[:, which], seconds)
        self.peak = max(self.peak, found.peak_mib)
        return result


def with_cpu_seconds(call: Callable[[], T]) -> tuple[T, float]:
    """A call's result, and the processor's seconds that it took."""
    start = time.process_time()
    return call(), time.process_time() - start


def row(tmc3: str, profile: str, rate: str, points: Floats, repeats: int) -> str:
    """One line of the table, the reference first, then ours and the ratio."""
    changes = {"rates": RATES, "options": {"profile": profile}}
    named = {"rates": RATES, "options": {"profile": profile, "program": tmc3}}
    theirs, ours = Turn(open_codec("tmc13", named)), Turn(open_codec("gpcc", changes))
    ours.codec.load()
    for _ in range(repeats):
        theirs.take(points, rate)
        ours.take(points, rate)
    size = f"{theirs.bytes:,} / {ours.bytes:,} ({ours.bytes / theirs.bytes - 1:+.2%})"
    pairs = zip(theirs.seconds.flat, ours.seconds.flat, strict=True)
    times = [f"{a:.2f} / {b:.2f} ({b / a:.2f})" for a, b in pairs]
    memory = f"{theirs.peak:.0f} / {ours.peak:.0f}"
    cells = (profile, f"{RATES[rate]['scale']:g}", f"{ours.points:,}", size, *times, memory)
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--profiles", nargs="+", default=["minimal", "ctc", "defaults"])
    parser.add_argument("--clean", action="store_true", help="the room without errors")
    options = parser.parse_args()
    points = scanned_room("none" if options.clean else "vlp16_divergence")
    print(f"{len(points):,} points; TMC13 / ours (ratio)\n")
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    for profile in options.profiles:
        for rate in RATES:
            print(row(options.tmc3, profile, rate, points, options.repeats), flush=True)


if __name__ == "__main__":
    main()
