"""The reference software of G-PCC beside our coder: its runs, its options, and what both make."""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.turns import Turn
from numpy.typing import NDArray

from cloud_files.clouds import read_cloud, write_cloud
from gpcc.coder import decode_geometry
from gpcc.sensor import SensorDescription
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.external import write_points

SECONDS, MEMORY = 30, 2**31
"""That one of TMC3's processes may take: slices of a flat cloud have it search for ever."""

SLICED = {"partitionMethod": 4, "sliceMaxPoints": 1500, "sliceMinPoints": 500}
DECODER_MODES: dict[str, dict[str, Any]] = {
    "slices": SLICED,
    "slices continued": {**SLICED, "entropyContinuationEnabled": 1},
    "bypass": {"cabac_bypass_stream_enabled_flag": 1},
    "zyx": {"geometry_axis_order": 0},
    "yzx": {"geometry_axis_order": 5},
    "tiles": {"tileSize": 4096},
}
"""Options of TMC3 that our encoders do not have."""


class Reference:
    """TMC3 on files in a folder; `said` and `seconds` are those of its last process."""

    said: str = ""
    seconds: float = 0.0

    def __init__(self, program: str, folder: Path) -> None:
        self._program, self._folder = program, folder

    def encode(
        self,
        points: Floats,
        options: Mapping[str, Any],
        scale: float = 1,
        reflectances: NDArray[Any] | None = None,
    ) -> bytes:
        """The stream of points, whole numbers; scaled as TMC3 does it."""
        if reflectances is None:
            write_points(self._folder / "in.ply", points, "float64")
        else:
            values = {"reflectance": reflectances.astype(np.uint16)}
            file = self._folder / "in.ply"
            write_cloud(file, PointCloud(points, fields=values))
            head, end, rows = file.read_bytes().partition(b"end_header")
            head = head.replace(b"double", b"float64").replace(b"ushort", b"uint16")
            file.write_bytes(head + end + rows)  # the only names that TMC3 knows
        given = {"uncompressedDataPath": self._folder / "in.ply", "disableAttributeCoding": 1}
        self._run({"mode": 0, **given, "positionQuantizationScale": scale, **options})
        return (self._folder / "stream.bin").read_bytes()

    def decode(self, stream: bytes) -> Floats:
        (self._folder / "stream.bin").write_bytes(stream)
        out = self._folder / "out.ply"
        self._run({"mode": 1, "outputBinaryPly": 1, "reconstructedDataPath": out})
        return read_cloud(out).xyz

    def printed_seconds(self, clock: str) -> float:
        """Time that it printed last, without that of files; clock: wall or user."""
        found = re.search(rf"Processing time \({clock}\): (\S+) s", self.said)
        assert found
        return float(found[1])

    def _run(self, options: Mapping[str, Any]) -> None:
        known = {"compressedStreamPath": self._folder / "stream.bin", **options}
        start = time.perf_counter()
        ran = subprocess.run(
            [self._program, *(f"--{name}={value}" for name, value in known.items())],
            check=True,
            capture_output=True,
            timeout=SECONDS,
            text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
        )
        self.said, self.seconds = ran.stdout, time.perf_counter() - start


def sensor_options(sensor: SensorDescription) -> dict[str, Any]:
    lasers = sorted(zip(sensor.tan_elevation, sensor.height, strict=True))
    return {
        "angularEnabled": 1,
        "numLasers": len(lasers),
        "lasersTheta": ",".join(repr(tan) for tan, _ in lasers),
        "lasersZ": ",".join(repr(-height) for _, height in lasers),
        "lasersNumPhiPerTurn": ",".join([str(sensor.steps_per_turn)] * len(lasers)),
        "lidarHeadPosition": ",".join(map(str, sensor.position)),
    }


class Checked(NamedTuple):
    """One case: bytes of both (0: none), and what is wrong."""

    ours: int
    reference: int
    same: bool
    fault: str


def judged(mine: bytes, theirs: bytes, faults: Mapping[str, bool]) -> Checked:
    """A case that both coded; `faults`: whether each is there. Ours may be 0.5 % larger."""
    faults = {**faults, "ours is larger": len(mine) > 1.005 * len(theirs) + 2}
    fault = "; ".join(name for name, is_there in faults.items() if is_there)
    return Checked(len(mine), len(theirs), mine == theirs, fault)


def differ(a: Floats, b: Floats) -> bool:
    return not np.array_equal(a[np.lexsort(a.T)], b[np.lexsort(b.T)])


def decode_with_both(
    reference: Reference,
    turn: Turn,
    options: Callable[[SensorDescription], dict[str, Any]],
    changes: Mapping[str, Any],
) -> Checked:
    """Decode a stream of TMC3 with both; options and changes are TMC3's."""
    theirs = reference.encode(turn.points.astype(float), {**options(turn.sensor), **changes})
    is_wrong = differ(decode_geometry(theirs).positions(), reference.decode(theirs))
    return Checked(0, len(theirs), False, "we decode TMC3's otherwise" if is_wrong else "")


class Tally:
    cases = failed = identical = coded = refused = 0

    def add(self, where: str, found: Checked) -> None:
        self.cases, self.failed = self.cases + 1, self.failed + bool(found.fault)
        self.coded, self.identical = self.coded + (found.ours > 0), self.identical + found.same
        said = found.fault or ("identical" if found.same else "the same points")
        print(f"{where}: {found.ours} / {found.reference} bytes, {said}", flush=True)

    def refuse(self, where: str, error: Exception) -> None:
        self.refused += 1
        why = str(error).rpartition("]")[2].lstrip("' ")
        print(f"{where}: {why}", flush=True)

    def end(self) -> None:
        print(f"{self.cases} cases, {self.identical} of {self.coded} byte-identical, ", end="")
        print(f"{self.failed} failed; not coded: {self.refused}")
        sys.exit(self.failed > 0)


def crosscheck(
    about: str | None,
    turns: Callable[[list[Path]], Iterator[Turn]],
    modes: Mapping[str, Callable[[Reference, Turn], Checked]],
    refusals: tuple[type[Exception], ...] = (),
) -> None:
    """Command line of a check of turns in modes.

    Parameters
    ----------
    about
        Its help.
    turns
        Every cloud that is coded, of a list of recordings.
    modes
        What is done with each, by the name of the mode.
    refusals
        Errors of ours that say that a case cannot be coded; TMC3's always do.
    """
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("tmc3")
    parser.add_argument("--recordings", nargs="+", type=Path, default=[])
    parser.add_argument("--turns", nargs="+", help="these alone, by name")
    parser.add_argument("--modes", nargs="+", help="these alone, by name")
    options, tally = parser.parse_args(), Tally()
    expected: tuple[type[Exception], ...] = (subprocess.SubprocessError, *refusals)
    with tempfile.TemporaryDirectory() as folder:
        reference = Reference(options.tmc3, Path(folder))
        for turn in turns(options.recordings):
            if options.turns and turn.name not in options.turns:
                continue
            for mode in options.modes or modes:
                where = f"{turn.name}, {mode}"
                try:
                    tally.add(where, modes[mode](reference, turn))
                except expected as error:
                    tally.refuse(where, error)
    tally.end()
