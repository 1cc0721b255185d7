"""Fuzzing of every decoder and reader: what they get must decode or end in one clean error.

    python -m benchmarks.checks.fuzz [--seconds 300] [--streams N] [--codecs NAME ...] [--first 0]
                              [--keep FOLDER] [--kind damaged|structured|both] [--unchecked]
                              [--only codecs|readers]

All decoders share the seconds; with --streams each gets that many streams instead. Every other one
is structured: fields at their limits, written by the codecs' own writers
(tests/support/structured_streams.py). The others are small clouds coded at several rates, for
G-PCC the conformance vectors, damaged by tests/support/stream_damage.py, half of them with check
sums that fit again. The readers of files ("read las"; tests/support/*_readers.py) get small
files damaged in the same ways, and structured ones (tests/support/structured_files.py). Number N is
the same in every run. Each decoder has a process of its own, whose
compiled loops check every index; that is slow, so that limits of time are CHECKED_FACTOR as long.
With --unchecked it runs as users run it, with the real limits.

A fault is whatever ends that process, an
exception other than InputError or of several lines, coordinates that are not finite, and what takes
more of the processor (SECONDS) or of memory (MIB, above what was there before) than any stream
should: its number is printed and its stream kept in FOLDER. Prints counts, the slowest and the
largest; exit status 1 after a fault. Codecs whose programs are not installed are left out, and
named.
"""

from __future__ import annotations

import argparse
import logging
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tests.support import file_readers, recording_readers
from tests.support.attribute_streams import AttributesDecoder
from tests.support.codecs import decode, encode, encode_returns
from tests.support.puck_streams import DECODERS
from tests.support.returns import EXAMPLES
from tests.support.stream_damage import damaged
from tests.support.structured_streams import WRITERS, structured

from gpcc.conformance import FOLDER
from pointkit.errors import InputError
from pointkit.lidar.returns import Returns
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded_surfaces, why_not_here
from puckbench.codecs.learned import Learned
from puckbench.codecs.rates import scaled_rates
from puckbench.codecs.registry import codec_class, codecs, codes_surfaces, open_codec
from puckbench.codecs.returns_codec import ReturnsCodec

ROOT = Path(__file__).parents[2]
READERS = {**file_readers.READERS, **recording_readers.READERS}
SECONDS, MIB = 5, 1024
READER_SECONDS, READER_MIB = 10, 2048
"""A file of less than a megabyte."""
OTHERS: dict[str, Any] = {
    **DECODERS,
    "gpcc (attributes)": AttributesDecoder,
    **{name: partial(dict.get, READERS, name) for name in READERS},
}
LEARNED_SECONDS = 30
"""A network at work on as many voxels as a stream of some thousand bytes may promise."""
CHECKED_FACTOR = 4
"""Time of loops with checked indices to the time of those without, at most."""
CHECKED = "NUMBA_BOUNDSCHECK"
DRACO_MIB = 4096
"""Draco may promise 8192 points a byte, as rooms of ten million points at its lowest rate need."""
ADDRESS_SPACE = 2**32
"""Bytes that a decoder may ask for beyond what it had: what is refused must end cleanly, too."""
AWAKE = 20
"""Wall clock to processor time, at most, before a decoder counts as hanging."""


VECTORS = {"gpcc": "*.bin", "gpcc_angular": "spin*.bin", "gpcc_predictive": "t[ru]*_*.bin"}
"""Conformance vectors of a decoder."""


class Line(NamedTuple):
    number: int
    seconds: float
    mib: float
    found: str

    @property
    def is_fault(self) -> bool:
        return self.found not in {"points", "error"}


@dataclass
class Tally:
    counts: Counter[str] = field(default_factory=Counter)
    slowest: tuple[float, int] = (0.0, -1)
    largest: tuple[float, int] = (0.0, -1)

    def add(self, line: Line) -> None:
        self.counts["fault" if line.is_fault else line.found] += 1
        self.slowest = max(self.slowest, (line.seconds, line.number))
        self.largest = max(self.largest, (line.mib, line.number))

    def __str__(self) -> str:
        counts = [self.counts.total(), *(self.counts[k] for k in ("error", "points", "fault"))]
        slowest, largest = self.slowest, self.largest
        numbers = "".join(f"{count:9}" for count in counts)
        return f"{numbers}  {slowest[0]:7.2f} (#{slowest[1]})  {largest[0]:7.0f} (#{largest[1]})"


def decoders() -> dict[str, str]:
    """Every decoder that can run here, or why not: codecs of derived classes share theirs."""
    found: dict[str, str] = {}
    classes: list[type[Codec]] = []
    for name, own in codecs().items():
        if any(issubclass(own, other) or issubclass(other, own) for other in classes):
            continue
        classes.append(own)
        found[name] = "" if _is_tiny(name) else why_not_here(open_codec(name))
        if codes_surfaces(name):
            found[f"{name} (mesh)"] = found[name]
        if name == "gpcc":
            found["gpcc (framed)"] = found[name]
    return found | dict.fromkeys(OTHERS, "")


def _is_tiny(name: str) -> bool:
    """Whether a codec has no weights here and gets random ones; PyTorch must be there."""
    from importlib.util import find_spec

    return _is_network(name) and bool(why_not_here(open_codec(name))) and _has(find_spec)


def _is_network(name: str) -> bool:
    return issubclass(codec_class(name), Learned)


def _has(find_spec: Any) -> bool:
    return find_spec("torch") is not None and find_spec("constriction") is not None


def opened(decoder: str) -> Any:
    if decoder in OTHERS:
        return OTHERS[decoder]()
    name = decoder.partition(" ")[0]
    changes: dict[str, Any] = {}
    if _is_tiny(name):
        from tests.support.learned_codecs import changes as with_weights
        from tests.support.learned_codecs import save_tiny, weights_name

        folder = Path(tempfile.gettempdir()) / f"puckbench-fuzz-{os.getpid()}"
        folder.mkdir(exist_ok=True)
        weights = folder / weights_name(name)
        save_tiny(name, weights)
        changes = with_weights(name, weights)
    if decoder.endswith("(framed)"):
        changes = {"options": {"unit": 0.3}}
    codec = open_codec(name, changes)
    codec.load()
    return codec


def streams(decoder: str, codec: Any) -> list[bytes]:
    if decoder in OTHERS:
        whole: list[bytes] = codec.streams()
        return whole
    if decoder in VECTORS:
        return [file.read_bytes() for file in sorted(FOLDER.glob(VECTORS[decoder]))]
    rates = list(scaled_rates(codec.rates) or codec.rates)
    rates = rates[:: max(1, len(rates) // 3)]
    if isinstance(codec, ReturnsCodec):
        return [encode_returns(codec, each, rate) for each in returns_of(codec) for rate in rates]
    unit = 1.0 if scaled_rates(codec.rates) else 1 / 128
    found = [encode(codec, cloud * unit, rate) for cloud in clouds() for rate in rates]
    if decoder.startswith("primitives"):  # about as many with primitives as without
        found += [encode(codec, shapes(), rate) for rate in ("r1", "r3", "r5", "r7")] * 5
    if decoder.endswith("(mesh)"):
        return [stream for stream in found if outcome(decoder, codec, stream) == "points"]
    return found


def returns_of(codec: Any) -> list[Returns]:
    found = []
    for make in EXAMPLES.values():
        with suppress(InputError):
            returns = make()
            encode_returns(codec, returns, next(iter(codec.rates)))
            found.append(returns)
    return found


def clouds() -> list[np.ndarray]:
    """A ball of voxels, a noisy corner of a room, a cylinder, a line, few points, one far away."""
    random = np.random.default_rng(0)
    ball = random.normal(size=(900, 3))
    ball = np.unique(
        np.rint(30 + ball * (12 / np.linalg.norm(ball, axis=1, keepdims=True))), axis=0
    )
    walls = [random.random((500, 3)) * [1, 1, 0], random.random((500, 3)) * [1, 0, 1]]
    corner = np.concatenate(walls) * 600 + random.normal(size=(1000, 3))
    angle = random.random(800) * 2 * np.pi
    column = np.stack([40 * np.cos(angle), 40 * np.sin(angle), random.random(800) * 300], axis=1)
    line = np.column_stack([np.arange(60.0), np.zeros(60), np.zeros(60)])
    return [ball, corner, column + 500, line, random.random((5, 3)) * 1000, np.full((1, 3), -1e5)]


def shapes() -> np.ndarray:
    """A corner of a room with a column, a ball and a cone: enough points for primitives to pay.

    Few points are cheaper as voxels at every rate, and of these `clouds` are full.
    """
    random = np.random.default_rng(1)
    square = random.random((3, 8000, 2)) * 900
    walls = [np.insert(part, axis, 0, axis=1) for axis, part in enumerate(square)]
    angle, up = random.random((2, 6000)) * [[2 * np.pi], [1]]
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(6000)])
    column = ring * 90 + [300, 300, 0] + up[:, None] * [0, 0, 700]
    cone = ring * (150 * (1 - up))[:, None] + [650, 250, 0] + up[:, None] * [0, 0, 400]
    ball = random.normal(size=(6000, 3))
    ball = ball * (150 / np.linalg.norm(ball, axis=1, keepdims=True)) + [600, 650, 400]
    together = np.concatenate([*walls, column, cone, ball])
    return together + random.normal(size=together.shape)


def made(decoder: str, whole: list[bytes], number: int, kind: str) -> bytes:
    name = decoder.partition(" ")[0]
    if kind == "both":
        kind, number = ("damaged", "structured")[number % 2], number // 2
    writer = decoder if decoder in WRITERS else name
    if kind == "structured" and decoder in READERS:
        return READERS[decoder].structured(whole, number)
    if kind == "structured" and writer in WRITERS:
        return structured(writer, whole, number)
    return damaged(whole, number, name)


def work(decoder: str, first: int, end: int, kind: str) -> None:
    """Decode the streams from `first` on, a line for each; what kills us is seen from outside."""
    logging.getLogger("puckbench").addHandler(logging.NullHandler())
    codec = opened(decoder)
    whole = streams(decoder, codec)
    for stream in whole:
        outcome(decoder, codec, stream)
    limit = seconds_of(decoder)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + ADDRESS_SPACE, size + ADDRESS_SPACE))
    print("ready", flush=True)
    for number in range(first, end):
        stream = made(decoder, whole, number, kind)
        signal.setitimer(signal.ITIMER_PROF, limit)  # ends the process: no handler is heard
        signal.alarm(limit * AWAKE)
        before, start = _peak_mib(reset=True), time.process_time()
        found = outcome(decoder, codec, stream)
        seconds, mib = time.process_time() - start, _peak_mib() - before
        signal.setitimer(signal.ITIMER_PROF, 0)
        if mib > mib_of(decoder):
            found = f"{mib:.0f} MiB for {len(stream)} bytes"
        print(number, f"{seconds:.4f}", f"{mib:.1f}", found, flush=True)


def mib_of(decoder: str) -> int:
    if decoder in READERS:
        return READER_MIB
    return DRACO_MIB if decoder.startswith("draco") else MIB


def seconds_of(decoder: str) -> int:
    if decoder in READERS:
        return READER_SECONDS
    is_learned = decoder not in OTHERS and _is_network(decoder.partition(" ")[0])
    seconds = LEARNED_SECONDS if is_learned else SECONDS
    return seconds * (CHECKED_FACTOR if os.environ.get(CHECKED) else 1)


def _peak_mib(reset: bool = False) -> float:
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def outcome(decoder: str, codec: Any, stream: bytes) -> str:
    """What decoding ends in: ``points``, ``error``, or what is wrong."""
    try:
        if decoder.endswith("(mesh)"):
            points = decoded_surfaces(codec, stream).vertices
        else:
            is_codec = isinstance(codec, Codec)
            points = decode(codec, stream) if is_codec else codec.decode(stream)
    except InputError as error:
        return "error" if "\n" not in str(error) else "an error of several lines"
    except Exception as error:  # noqa: BLE001 (whatever it is, it is a finding)
        return f"{type(error).__name__}: {error}".replace("\n", " ")[:300]
    return "points" if np.isfinite(points).all() else "coordinates that are not finite"


def results(decoder: str, first: int, end: int, seconds: float, kind: str) -> Iterator[Line]:
    """What became of each stream, over as many processes as that needs, in the seconds given.

    The first process gets ready before the clock starts.
    """
    deadline = 0.0
    while first < end:
        module = "benchmarks.checks.fuzz"
        words = [sys.executable, "-m", module, "--worker", decoder, str(first), str(end), kind]
        with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True) as worker:
            assert worker.stdout is not None
            if worker.stdout.readline() != "ready\n":
                raise SystemExit(f"{decoder}: does not decode what is not damaged")
            deadline = deadline or time.monotonic() + seconds
            for text in worker.stdout:
                number, took, mib, found = text.rstrip("\n").split(" ", 3)
                yield Line(int(number), float(took), float(mib), found)
                first = int(number) + 1
                if time.monotonic() > deadline:
                    worker.kill()
                    return
        if worker.returncode:
            limit = float(seconds_of(decoder))
            yield Line(first, limit, 0.0, f"process ended with {worker.returncode}")
            first += 1


def campaign(decoder: str, options: argparse.Namespace, seconds: float) -> Tally:
    tally = Tally()
    end = options.first + options.streams
    for line in results(decoder, options.first, end, seconds, options.kind):
        tally.add(line)
        if line.is_fault:
            print(f"{decoder} #{line.number}: {line.found[:160]}", flush=True)
            keep(decoder, line.number, options.keep, options.kind)
    return tally


def keep(decoder: str, number: int, folder: Path | None, kind: str) -> None:
    """Write the stream of a fault, if there is a folder for it."""
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        name = decoder.partition(" ")[0] if decoder not in READERS else decoder.replace(" ", "_")
        suffix = READERS[decoder].suffix if decoder in READERS else ".bin"
        stream = made(decoder, streams(decoder, opened(decoder)), number, kind)
        (folder / f"{name}_{number}{suffix}").write_bytes(stream)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--streams", type=int, help="of each decoder, however long they take")
    parser.add_argument("--codecs", nargs="+", help="names of decoders; all that run here")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the streams of faults")
    parser.add_argument("--kind", choices=("damaged", "structured", "both"), default="both")
    parser.add_argument("--unchecked", action="store_true", help="indices; real limits of time")
    parser.add_argument("--only", choices=("codecs", "readers"))
    parser.add_argument("--worker", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        decoder, first, end, kind = options.worker
        work(decoder, int(first), int(end), kind)
        return
    if not options.unchecked:
        os.environ[CHECKED] = "1"  # of the workers, too
    known = decoders() if options.only != "readers" else dict.fromkeys(READERS, "")
    if options.only == "codecs":
        known = {name: why for name, why in known.items() if name not in READERS}
    chosen = options.codecs or [name for name, why in known.items() if not why]
    seconds = float("inf") if options.streams else options.seconds / len(chosen)
    options.streams = options.streams or sys.maxsize // 2
    faults = 0
    print(
        f"{'decoder':20}{'streams':>9}{'errors':>9}{'decoded':>9}{'faults':>9}  slowest s  most MiB"
    )
    for decoder in chosen:
        tally = campaign(decoder, options, seconds)
        faults += tally.counts["fault"]
        print(f"{decoder:20}{tally}", flush=True)
    for name, why in known.items():
        if why and not options.codecs:
            print(f"{name}: left out ({why})")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
