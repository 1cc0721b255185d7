"""Writing or reading of a long stream turn by turn, as while a sensor sends it.

    python -m benchmarks.performance.live_turns write FILE RECORDING [--packets 1000000]
    python -m benchmarks.performance.live_turns read FILE

The turns of a recording of a VLP-16 are repeated with later clocks. Afterwards, a line tells the
packets, the processor time in s and the peak memory of this process in MiB.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import Turn
from puck import CodingOptions, Writer, packet_kind, read_turns
from puck.recordings.packet_turns import find_packets, split_turns, turn_of
from puck.recordings.packets import PACKET_BYTES, STRONGEST_MODE, VLP16

KIND = packet_kind(VLP16, STRONGEST_MODE)


def repeated_turns(recording: Path, packets: int) -> Iterator[Turn]:
    """Yield turns until they have so many packets or more."""
    data = np.fromfile(recording, np.uint8)
    found = data[find_packets(data)[:, None] + np.arange(PACKET_BYTES)]
    turns = [turn_of(KIND, part) for _, part in split_turns(found)]
    times = [turn.times.astype(np.int64) for turn in turns if turn.times is not None]
    duration_us = 2 * times[-1][-1] - times[-1][-2] - times[0][0]
    count = repetition = 0
    while True:
        for turn, since in zip(turns, times, strict=True):
            if count >= packets:
                return
            later = (since + repetition * duration_us) % HOUR_US
            yield replace(turn, times=later.astype(np.uint32))
            count += len(since)
        repetition += 1


def write(path: Path, recording: Path, packets: int) -> int:
    count = 0
    with path.open("wb") as file, Writer(file, KIND.layout, CodingOptions(effort="fast")) as writer:
        for turn in repeated_turns(recording, packets):
            writer.add(turn)
            count += len(turn.azimuths) // KIND.layout.blocks_per_time
    return count


def read(path: Path) -> int:
    with path.open("rb") as file:
        blocks = sum(len(turn.azimuths) for turn in read_turns(file))
    return blocks // KIND.layout.blocks_per_time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=("write", "read"))
    parser.add_argument("file", type=Path)
    parser.add_argument("recording", type=Path, nargs="?")
    parser.add_argument("--packets", type=int, default=1_000_000)
    options = parser.parse_args()
    if options.action == "write":
        count = write(options.file, options.recording, options.packets)
    else:
        count = read(options.file)
    mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{count:,} packets, {time.process_time():.1f} processor s, {mib:.0f} MiB")


if __name__ == "__main__":
    main()
