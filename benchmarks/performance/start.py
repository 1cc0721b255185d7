"""Seconds and memory of short commands, as whole processes: mostly their start.

    python -m benchmarks.performance.start [--repeats 5]

The commands take turns, and the least of the repeats counts; the first, which may compile, does
not. They read three turns of a virtual VLP-16; the rival of `compress` is a process of Python that
packs the same capture with lzma, as `xz -9e`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.clouds import write_recording
from benchmarks.performance.rows import Inputs, Row

XZ = "xz -9e"
UNITS = {"time": "processor s", "time on the wall": "s", "memory": "MiB"}
_PACK = "import lzma, pathlib; data = pathlib.Path('r.pcap').read_bytes()"
_PUCKBENCH = ("-m", "puckbench")
COMMANDS = {
    XZ: ("-c", f"{_PACK}; lzma.compress(data, preset=9 | lzma.PRESET_EXTREME)"),
    "puckbench --help": (*_PUCKBENCH, "--help"),
    "puckbench codecs": (*_PUCKBENCH, "codecs"),
    "puckbench compress": (*_PUCKBENCH, "compress", "r.pcap", "r.puck"),
    "puckbench decompress": (*_PUCKBENCH, "decompress", "r.puck", "back.pcap"),
    "puckbench export": (*_PUCKBENCH, "export", "r.pcap", "r.ply"),
    "puckbench encode": (
        *_PUCKBENCH,
        "encode",
        "r.ply",
        "r.bin",
        "--codec",
        "draco",
        "--rate",
        "r4",
    ),
    "puckbench decode": (*_PUCKBENCH, "decode", "r.bin", "back.ply"),
}
"""Words after Python's, by name; a command may need the files of those before it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    for row in starts(parser.parse_args().repeats):
        print(row, flush=True)


def measure(inputs: Inputs) -> Iterator[Row]:
    return starts(inputs.repeats(5))


def starts(repeats: int) -> Iterator[Row]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_recording(folder / "r.pcap", 3)
        runs = [[process(words, folder) for words in COMMANDS.values()] for _ in range(repeats + 1)]
    least = np.min(runs[1:], axis=0).tolist()
    costs = dict(zip(COMMANDS, least, strict=True))
    for name, values in costs.items():
        if name != XZ:
            rivals = costs[XZ] if name == "puckbench compress" else [None] * len(UNITS)
            for (what, unit), value, rival in zip(UNITS.items(), values, rivals, strict=True):
                program = "" if rival is None else XZ
                yield Row(f"{name}: {what}", value, unit, program, rival, repeats=repeats)


def process(words: tuple[str, ...], folder: Path) -> list[float]:
    """Values of a run of Python, in `UNITS`."""
    start = time.perf_counter()
    child = subprocess.Popen([sys.executable, *words], cwd=folder, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    wall_s = time.perf_counter() - start
    child.returncode = status
    if status:
        raise SystemExit(f"{words}: status {status}")
    return [used.ru_utime + used.ru_stime, wall_s, used.ru_maxrss / 1024]


if __name__ == "__main__":
    main()
