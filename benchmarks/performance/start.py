"""Seconds of short commands, as whole processes: mostly their start.

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
_READ = "import lzma, pathlib; data = pathlib.Path('r.pcap').read_bytes()"
COMMANDS = {
    "--help": "--help",
    "codecs": "codecs",
    "compress": "compress r.pcap r.puck",
    "decompress": "decompress r.puck back.pcap",
    "export": "export r.pcap r.ply",
    "encode": "encode r.ply r.bin --codec draco --rate r4",
    "decode": "decode r.bin back.ply",
}
"""Words after `puckbench`; a command may need the files of those before it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    for row in starts(parser.parse_args().repeats):
        print(row, flush=True)


def measure(inputs: Inputs) -> Iterator[Row]:
    return starts(inputs.repeats(5))


def starts(repeats: int) -> Iterator[Row]:
    words = {name: ["-m", "puckbench", *text.split()] for name, text in COMMANDS.items()}
    words[XZ] = ["-c", f"{_READ}; lzma.compress(data, preset=9 | lzma.PRESET_EXTREME)"]
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_recording(folder / "r.pcap", 3)
        runs = [[seconds(each, folder) for each in words.values()] for _ in range(repeats + 1)]
    least = dict(zip(words, np.min(runs[1:], axis=0).tolist(), strict=True))
    for name in COMMANDS:
        rivals = least[XZ] if name == "compress" else [None, None]
        for unit, value, rival in zip(("processor s", "s"), least[name], rivals, strict=True):
            program = "" if rival is None else XZ
            yield Row(f"puckbench {name}", value, unit, program, rival, repeats=repeats)


def seconds(words: list[str], folder: Path) -> list[float]:
    """Seconds of the processor and on the wall of a process of Python."""
    start = time.perf_counter()
    child = subprocess.Popen([sys.executable, *words], cwd=folder, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    wall_s = time.perf_counter() - start
    child.returncode = status
    if status:
        raise SystemExit(f"{' '.join(words)}: status {status}")
    return [used.ru_utime + used.ru_stime, wall_s]


if __name__ == "__main__":
    main()
