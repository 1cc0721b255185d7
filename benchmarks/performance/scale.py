"""Time and memory of `puckbench run` on large input.

    python -m benchmarks.performance.scale [cloud] [recording] [folder] [--points 20000000]
        [--megabytes 1000] [--clouds 300] [--folder DIR] [--run WORDS...]

For `make measure`, commands on the recording and turns written one by one are measured as well.

The cloud is sampled on a generated office; the recording repeats twenty turns of a virtual VLP-16,
with later clocks; the folder has clouds of 10,000 points (or as many as the cloud, if it has
fewer). They are made in DIR, or used if they are there. WORDS are further arguments of the runs.

For each run: wall clock, processor time of all processes, peak memory of the largest process, and
the peak of the sum of all processes (pages that several share count once, sampled). Then, for each
step, the jobs, their processor time, and the peak memory of the largest, as their logs tell.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.performance.rows import Inputs, Row
from benchmarks.turns import virtual_scan

from cloud_files.ply import write_ply
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from puck.recordings.packets import PACKET
from puckbench.core.children import adopt_orphans
from puckbench.geometry.sampling import sample_surface
from puckbench.recordings.writing import pcap_bytes, scan_packets
from puckbench.steps.cost import read_costs
from virtual_lidar.scenes.objects import make_object
from virtual_lidar.scenes.rooms import make_room

PORTION = 1_000_000
TURNS = 20
HOUR_US = 3_600_000_000
PCAP_HEADER = 24


def write_cloud(path: Path, options: argparse.Namespace) -> None:
    _write_samples(path, make_room("office_1", seed=1), options.points)


def write_recording(path: Path, options: argparse.Namespace) -> None:
    log = scan_packets(virtual_scan("vlp16", TURNS))
    duration_us = round(1e6 * float(log.received[-1] + log.received[1] - 2 * log.received[0]))
    with path.open("wb") as file:
        repetition = 0
        while file.tell() < 1e6 * options.megabytes:
            later_us = repetition * duration_us
            payloads = log.payloads.copy()
            packets = payloads.view(PACKET)
            packets["time_us"] = (packets["time_us"].astype(np.int64) + later_us) % HOUR_US
            later = replace(log, payloads=payloads, received=log.received + later_us / 1e6)
            file.write(pcap_bytes(later)[PCAP_HEADER if repetition else 0 :])
            repetition += 1


def write_folder(path: Path, options: argparse.Namespace) -> None:
    path.mkdir()
    mesh = make_object("chair_01", seed=1)
    for number in range(options.clouds):
        cloud = path / f"cloud_{number:03}.ply"
        _write_samples(cloud, mesh, min(10_000, options.points), number)


def _write_samples(path: Path, mesh: Mesh, points: int, seed: int = 1) -> None:
    random = generator(seed, "benchmark of scale")
    counts = [min(PORTION, points - begin) for begin in range(0, points, PORTION)]
    parts = [sample_surface(mesh, count, random).xyz.astype("<f4") for count in counts]
    xyz = np.concatenate(parts)
    write_ply(path, {axis: xyz[:, column] for column, axis in enumerate("xyz")})


INPUTS: dict[str, tuple[str, Callable[[Path, argparse.Namespace], None]]] = {
    "cloud": ("cloud.ply", write_cloud),
    "recording": ("recording.pcap", write_recording),
    "folder": ("clouds", write_folder),
}


class Cost(NamedTuple):
    """Seconds on the wall and of all processors, and peak memory of one and of all processes."""

    wall_s: float
    processor_s: float
    largest_mib: float
    together_mib: float


def run(source: Path, out: Path, words: Sequence[str] = ()) -> Cost:
    """Run the benchmark on a file or folder, into the folder `out`, and return what it took."""
    command = ["-m", "puckbench", "run", str(source), "--out", str(out), *words]
    return cost_of(command, out.parent / f"{out.name}.txt")


def cost_of(words: Sequence[str], output: Path) -> Cost:
    """Run Python with these words, write what it prints to a file, and return what it took."""
    start = time.perf_counter()
    adopt_orphans()  # the server of jobs is killed before its last children are waited for
    with output.open("w+") as text:
        command = [sys.executable, *words]
        child = subprocess.Popen(command, cwd=output.parent, stdout=text, stderr=subprocess.STDOUT)
        processor_s, largest_kib, together_kib = 0.0, 0, 0
        with suppress(ChildProcessError):  # no process is left
            while True:
                ended, status, used = os.wait4(-1, os.WNOHANG)
                if ended:
                    processor_s += used.ru_utime + used.ru_stime
                    largest_kib = max(largest_kib, used.ru_maxrss)
                if ended == child.pid:
                    child.returncode = os.waitstatus_to_exitcode(status)
                if not ended:
                    before = time.perf_counter()
                    together_kib = max(together_kib, _resident_kib())
                    time.sleep(0.1 + 20 * (time.perf_counter() - before))
        if child.returncode:
            text.seek(0)
            raise SystemExit(text.read()[-2000:])
    wall_s = time.perf_counter() - start
    return Cost(wall_s, processor_s, largest_kib / 1024, together_kib / 1024)


def measure(inputs: Inputs) -> Iterator[Row]:
    """Large input through `draco` at one rate, which shows what the benchmark itself takes."""
    sizes = argparse.Namespace(points=20_000_000, megabytes=1000.0, clouds=300)
    if inputs.is_trial:
        sizes = argparse.Namespace(points=2000, megabytes=0.1, clouds=2)
    titles = {
        "cloud": f"{sizes.points:,} points",
        "recording": f"a recording of {sizes.megabytes:,.0f} MB",
        "folder": f"{sizes.clouds} clouds of 10,000 points",
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, (file, write) in INPUTS.items():
            write(Path(folder, file), sizes)
            words = ["--codecs", "draco", "--rates", *(["10mm"] if name == "recording" else ["r8"])]
            cost = run(Path(folder, file), Path(folder, f"out_{name}"), words)
            yield Row(f"run on {titles[name]}", cost.wall_s, "s")
            yield Row(f"run on {titles[name]}: all processes", cost.processor_s, "processor s")
            yield Row(f"run on {titles[name]}: largest process", cost.largest_mib, "MiB")
            yield Row(f"run on {titles[name]}: all processes together", cost.together_mib, "MiB")
        recording = Path(folder, INPUTS["recording"][0])
        yield from of_commands(recording, titles["recording"], int(1000 * sizes.megabytes))


def of_commands(recording: Path, title: str, packets: int) -> Iterator[Row]:
    """Measure commands on a recording, and by how much their memory grows from a short one's.

    Then packets of the short one are written and read turn by turn by `live_turns`.
    """
    folder = recording.parent
    short, printed = folder / "short.pcap", folder / "printed.txt"
    write_recording(short, argparse.Namespace(megabytes=0.1))
    costs: dict[str, list[Cost]] = defaultdict(list)
    for path in (short, recording):
        small, one_turn = path.with_suffix(".puck"), folder / "turn.ply"
        for name, words in {
            "compress --effort fast": ["compress", path, small, "--effort", "fast"],
            "decompress": ["decompress", small, folder / "back.pcap"],
            "export --turns 1-1": ["export", path, one_turn, "--turns", "1-1"],
            "export --turns 1-1 of .puck": ["export", small, one_turn, "--turns", "1-1"],
        }.items():
            costs[name].append(cost_of(["-m", "puckbench", *map(str, words)], printed))
    for name, (of_short, of_long) in costs.items():
        growth = of_long.together_mib - of_short.together_mib
        yield Row(f"{name} on {title}", of_long.processor_s, "processor s")
        yield Row(f"{name} on {title}: growth of memory", growth, "MiB")
    for action, words in {"write": [short, "--packets", packets], "read": []}.items():
        file = folder / "live.puck"
        script = Path(__file__).with_name("live_turns.py")
        # Without -P, modules beside the script would hide packages of the same name.
        cost = cost_of(["-P", *map(str, (script, action, file, *words))], printed)
        what = f"{action} {packets:,} packets turn by turn"
        yield Row(what, cost.processor_s, "processor s")
        yield Row(f"{what}: memory", cost.together_mib, "MiB", at_most=286)


def _resident_kib() -> int:
    """Return the memory of all descendants of this process; shared pages count once."""
    total, left = 0, [os.getpid()]
    while left:
        process = Path("/proc", str(left.pop()))
        with suppress(OSError):  # it has ended
            for children in process.glob("task/*/children"):
                left += map(int, children.read_text().split())
            if process.name != str(os.getpid()):
                lines = (process / "smaps_rollup").read_text().splitlines()
                total += next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total


def print_steps(logs: Path) -> None:
    jobs: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for cost in read_costs(logs):
        jobs[cost["job"]].append(cost)
    print(f"  {'step':16} {'jobs':>5} {'cpu s':>8} {'largest':>8} MiB")
    for name, costs in jobs.items():
        processor_s = sum(cost["processor_s"] for cost in costs)
        peak = max(cost["peak_mib"] for cost in costs)
        print(f"  {name:16} {len(costs):5} {processor_s:8.1f} {peak:8}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("inputs", nargs="*", choices=[*INPUTS, []], metavar="INPUT")
    parser.add_argument("--points", type=int, default=20_000_000)
    parser.add_argument("--megabytes", type=float, default=1000)
    parser.add_argument("--clouds", type=int, default=300)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--run", nargs=argparse.REMAINDER, default=[])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for name in options.inputs or INPUTS:
            file, write = INPUTS[name]
            if not (folder / file).exists():
                write(folder / file, options)
            out = folder / f"out_{name}"
            wall_s, processor_s, largest, together = run(folder / file, out, options.run)
            print(f"{'':10} {'wall s':>8} {'cpu s':>8} {'largest':>9} {'all':>9} MiB")
            print(f"{name:10} {wall_s:8.1f} {processor_s:8.1f} {largest:9.0f} {together:9.0f}")
            print_steps(out / "logs")


if __name__ == "__main__":
    main()
