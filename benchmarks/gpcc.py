"""Time, memory and size of our G-PCC coder and of the reference software, side by side.

    python benchmarks/gpcc.py TMC3 [--repeats 3] [--profiles minimal ctc defaults] [--clean]

A generated office, 1,152,000 returns with the VLP-16's errors, at scales 0.125, 0.5 and 1. TMC3's
seconds are those it prints, without its reading and writing of files; ours are of `encode` and
`decode` on arrays in memory, rounding and merging included, compiled before. The two take turns and
the least of the repeats counts: other work on the machine only adds. Memory is TMC3's whole
process, and ours above the arrays that were there before the call.
"""

from __future__ import annotations

import argparse
import re

import numpy as np

from gpcc_scenes import scanned_room
from puckbench.cloud import Floats
from puckbench.codecs.codec import Codec
from puckbench.codecs.external import ExternalCodec
from puckbench.codecs.measure import measured
from puckbench.codecs.registry import open_codec

RATES = {"a": {"scale": 0.125}, "b": {"scale": 0.5}, "c": {"scale": 1.0}}
HEADER = "| profile | scale | points | bytes, TMC13 / ours | encode, s | decode, s | memory, MiB |"


def printed_seconds(codec: ExternalCodec) -> float:
    """Seconds that the program says it took."""
    found = re.search(r"Processing time \(wall\): (\S+) s", codec.said)
    assert found is not None
    return float(found[1])


class Turn:
    """One codec's streams, least times and largest memory over the repeats."""

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self.seconds = [np.inf, np.inf]
        self.peak = [0.0, 0.0]

    def take(self, points: Floats, rate: str) -> None:
        encoded = measured(lambda: self.codec.encode(points, rate), outside=self.codec.cost)
        self._count(0, encoded.seconds, encoded.peak_mib)
        decoded = measured(lambda: self.codec.decode(encoded.result), outside=self.codec.cost)
        self._count(1, decoded.seconds, decoded.peak_mib)
        self.bytes, self.points = len(encoded.result), len(decoded.result)

    def _count(self, which: int, seconds: float, peak: float) -> None:
        if isinstance(self.codec, ExternalCodec):
            seconds = printed_seconds(self.codec)
        self.seconds[which] = min(self.seconds[which], seconds)
        self.peak[which] = max(self.peak[which], peak)


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
    times = [
        f"{a:.2f} / {b:.2f} ({b / a:.2f})"
        for a, b in zip(theirs.seconds, ours.seconds, strict=True)
    ]
    memory = f"{max(theirs.peak):.0f} / {max(ours.peak):.0f}"
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
    print(f"{len(points):,} points; TMC13 / ours (ratio)\n\n{HEADER}\n{'|---' * 7}|")
    for profile in options.profiles:
        for rate in RATES:
            print(row(options.tmc3, profile, rate, points, options.repeats), flush=True)


if __name__ == "__main__":
    main()
