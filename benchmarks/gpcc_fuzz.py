"""Damaged G-PCC streams by the thousand: each must decode or end in one clean error.

    python benchmarks/gpcc_fuzz.py [--streams 20000] [--first 0] [--keep FOLDER]

The streams are the conformance vectors, damaged by tests/unit/gpcc_mutations.py; number N is the
same in every run. They are decoded in a process of its own, which may take SECONDS of the
processor for each, and MEMORY more than it had before the first. Whatever ends that process, or any
exception but InputError, is a fault: its number is printed and its stream kept.
"""

from __future__ import annotations

import argparse
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "unit"))

from gpcc_mutations import damaged  # noqa: E402

from puckbench.codecs.registry import open_codec  # noqa: E402
from puckbench.errors import InputError  # noqa: E402

SECONDS = 5
MEMORY = 2**30


def vectors() -> list[bytes]:
    """The conformance vectors, smallest first."""
    files = sorted((ROOT / "tests" / "data" / "gpcc").glob("*.bin"))
    return [file.read_bytes() for file in files]


def work(first: int, end: int) -> None:
    """Decode the streams from `first` on, a line for each; what kills us is seen from outside."""
    streams, codec = vectors(), open_codec("gpcc")
    for stream in streams:
        outcome(codec, stream)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
    for number in range(first, end):
        stream = damaged(streams, number)
        signal.setitimer(signal.ITIMER_PROF, SECONDS)  # ends the process: no handler is heard
        start = time.process_time()
        found = outcome(codec, stream)
        signal.setitimer(signal.ITIMER_PROF, 0)
        print(number, f"{time.process_time() - start:.4f}", found, flush=True)


def outcome(codec: object, stream: bytes) -> str:
    """What decoding ends in: ``points``, ``error``, or the name of another exception."""
    try:
        codec.decode(stream)  # type: ignore[attr-defined]
    except InputError as error:
        return "error" if "\n" not in str(error) else "error of several lines"
    except Exception as error:  # noqa: BLE001 (whatever it is, it is a finding)
        return f"{type(error).__name__}: {error}".replace("\n", " ")
    return "points"


def results(first: int, end: int) -> Iterator[tuple[int, float, str]]:
    """Number, seconds and outcome of each stream, over as many processes as that needs."""
    while first < end:
        command = [sys.executable, __file__, "--worker", str(first), str(end)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as worker:
            assert worker.stdout is not None
            for line in worker.stdout:
                number, seconds, found = line.rstrip("\n").split(" ", 2)
                yield int(number), float(seconds), found
                first = int(number) + 1
        if worker.returncode:
            yield first, float(SECONDS), f"process ended with {worker.returncode}"
            first += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--streams", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the streams of faults")
    parser.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(*options.worker)
        return
    counts: Counter[str] = Counter()
    slowest = (0.0, -1)
    for number, seconds, found in results(options.first, options.first + options.streams):
        counts[found if found in {"points", "error"} else "fault"] += 1
        slowest = max(slowest, (seconds, number))
        if found not in {"points", "error"}:
            print(f"{number}: {found[:160]}", flush=True)
            if options.keep:
                options.keep.mkdir(parents=True, exist_ok=True)
                (options.keep / f"{number}.bin").write_bytes(damaged(vectors(), number))
    print(dict(counts), f"slowest {slowest[0]:.2f} s (number {slowest[1]})")


if __name__ == "__main__":
    main()
