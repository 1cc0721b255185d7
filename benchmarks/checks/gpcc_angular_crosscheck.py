"""The octree's angular mode against the reference software, both ways, over sensors and options.

    python -m benchmarks.checks.gpcc_angular_crosscheck TMC3 [--recordings PATH ...]
        [--turns NAME ...] [--modes NAME ...]

For each turn of a virtual sensor, of the recordings, and for clouds that no sensor measures, under
each set of options: what TMC3 decodes from our stream must be the points that were coded, what we
decode from TMC3's stream must be what TMC3 decodes from it, and our stream may be at most 0.5 %
larger. Options that only a decoder knows (slices, axis orders, several entropy streams) are checked
on TMC3's streams alone. What TMC3 itself cannot code is counted apart. Exit status 1 if any case
fails.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.turns import SENSORS, Turn, odd_turns, recorded_turns, virtual_turn

from puckbench.codecs.external.program import write_points
from puckbench.codecs.gpcc.coder import decode_geometry, encode_geometry
from puckbench.codecs.gpcc.grid import Frame, quantised
from puckbench.codecs.gpcc.options import GpccOptions
from puckbench.codecs.gpcc.sensor import SensorDescription
from puckbench.geometry.cloud import Floats
from puckbench.io.clouds import read_cloud

COMMON = {
    "planar": True,
    "qtbt": True,
    "intra_pred_max_node_size_log2": 6,
    "inferred_direct_coding_mode": 3,
    "max_num_qtbt_before_ot": 6,
    "planar_mode_idcm_use": 32,
    "merge_duplicates": False,
    "planar_buffer": False,
}
"""MPEG's common test conditions for a spinning sensor's sparse clouds."""

MODES: dict[str, dict[str, Any]] = {
    "common": {},
    "merged": {"merge_duplicates": True},
    "planar buffer": {"planar_buffer": True},
    "no direct coding": {"inferred_direct_coding_mode": 0},
    "direct coding 1": {"inferred_direct_coding_mode": 1},
    "direct coding 1, some": {"inferred_direct_coding_mode": 1, "planar_mode_idcm_use": 13},
    "direct coding 2": {"inferred_direct_coding_mode": 2, "planar_buffer": True},
    "points one by one": {"joint_two_point_idcm": False},
    "no planes": {"planar": False},
    "thresholds": {"planar_thresholds": (5, 10, 20), "planar_buffer": True},
    "no qtbt": {"qtbt": False},
    "qtbt late": {"max_num_qtbt_before_ot": 0, "min_qtbt_size_log2": 3},
    "siblings": {"neighbour_avail_boundary_log2": 0, "planar_buffer": True},
    "no adjacent children": {"adjacent_child_contextualization": False},
    "half": {"scale": 0.5},
    "eighth": {"scale": 0.125, "merge_duplicates": True},
}
"""Changes of our options by the name of a mode; scale: of the input."""

DECODER_MODES = {
    "slices": ("--partitionMethod=4", "--sliceMaxPoints=1500", "--sliceMinPoints=500"),
    "slices continued": (
        *("--partitionMethod=4", "--sliceMaxPoints=1500", "--sliceMinPoints=500"),
        "--entropyContinuationEnabled=1",
    ),
    "streams": ("--numOctreeEntropyStreams=5",),
    "bypass": ("--cabac_bypass_stream_enabled_flag=1",),
    "zyx": ("--geometry_axis_order=0",),
    "yzx": ("--geometry_axis_order=5",),
    "zxy": ("--geometry_axis_order=3",),
    "tiles": ("--tileSize=4096",),
}
"""Options of TMC3 that our encoder does not have."""


SECONDS = 20
"""What TMC3 may take: it slices a plane for ever."""


class Checked(NamedTuple):
    """One case: bytes of both (0: none), and what is wrong."""

    ours: int
    reference: int
    same: bool
    fault: str


def tmc3_options(options: GpccOptions, sensor: SensorDescription) -> list[str]:
    """Our options by the names of TMC3, and the sensor."""
    lasers = sorted(zip(sensor.tan_elevation, sensor.height, strict=True))
    first, second, third = options.planar_thresholds
    named = {
        "mergeDuplicatedPoints": int(options.merge_duplicates),
        "neighbourAvailBoundaryLog2": options.neighbour_avail_boundary_log2,
        "adjacentChildContextualization": int(options.adjacent_child_contextualization),
        "intra_pred_max_node_size_log2": options.intra_pred_max_node_size_log2,
        "planarEnabled": int(options.planar),
        "planarModeThreshold0": first,
        "planarModeThreshold1": second,
        "planarModeThreshold2": third,
        "planarBufferDisabled": int(not options.planar_buffer),
        "qtbtEnabled": int(options.qtbt),
        "maxNumQtBtBeforeOt": options.max_num_qtbt_before_ot,
        "minQtbtSizeLog2": options.min_qtbt_size_log2,
        "inferredDirectCodingMode": options.inferred_direct_coding_mode,
        "planarModeIdcmUse": options.planar_mode_idcm_use,
        "jointTwoPointIdcm": int(options.joint_two_point_idcm),
        "angularEnabled": 1,
        "numLasers": len(lasers),
        "lasersTheta": ",".join(repr(tan) for tan, _ in lasers),
        "lasersZ": ",".join(repr(-height) for _, height in lasers),
        "lasersNumPhiPerTurn": ",".join([str(sensor.steps_per_turn)] * len(lasers)),
        "lidarHeadPosition": ",".join(map(str, sensor.position)),
    }
    return [f"--{name}={value}" for name, value in named.items()]


class Reference:
    """TMC3 on files in a folder."""

    def __init__(self, program: str, folder: Path) -> None:
        self._program, self._folder = program, folder

    def encode(self, points: Floats, scale: float, options: list[str]) -> bytes:
        """The stream of points, whole numbers; scaled as TMC3 does it."""
        write_points(self._folder / "in.ply", points, "float64")
        self._run("--mode=0", "--disableAttributeCoding=1", f"--positionQuantizationScale={scale}",
                  f"--uncompressedDataPath={self._folder / 'in.ply'}", *options)  # fmt: skip
        return (self._folder / "stream.bin").read_bytes()

    def decode(self, stream: bytes) -> Floats:
        """The points of a stream."""
        (self._folder / "stream.bin").write_bytes(stream)
        out = self._folder / "out.ply"
        self._run("--mode=1", "--outputBinaryPly=1", f"--reconstructedDataPath={out}")
        return read_cloud(out).xyz

    def _run(self, *options: str) -> None:
        stream = f"--compressedStreamPath={self._folder / 'stream.bin'}"
        command = [self._program, stream, *options]
        subprocess.run(command, check=True, capture_output=True, timeout=SECONDS)


def equal(a: Floats, b: Floats) -> bool:
    return np.array_equal(a[np.lexsort(a.T)], b[np.lexsort(b.T)])


def checked(reference: Reference, turn: Turn, changes: dict[str, Any]) -> Checked:
    """Code with both, decode each stream with both."""
    known = {**COMMON, **changes}
    scale = known.pop("scale", 1)
    split = {
        "angular_max_node_min_dim_log2_to_split_z": 8 + int(np.log2(scale)),
        "angular_max_diff_to_split_z": max(0, 1 + int(np.log2(scale))),
    }
    options = GpccOptions(**known, **split)
    points, sensor = turn.points.astype(np.float64), turn.sensor
    theirs = reference.encode(points, scale, tmc3_options(options, sensor))
    x, y, z = (int(place * scale) for place in sensor.position)
    heights = tuple(height * scale for height in sensor.height)
    here = SensorDescription(sensor.tan_elevation, heights, sensor.steps_per_turn, (x, y, z))
    positions, origin = quantised(points, Frame(), scale, "truncate")
    mine = encode_geometry(positions, options, scale, origin.tolist(), here)
    decoded = reference.decode(theirs)
    faults = {
        "TMC3 decodes ours otherwise": equal(reference.decode(mine), decoded),
        "we decode TMC3's otherwise": equal(decode_geometry(theirs).positions(), decoded),
        "we decode ours otherwise": equal(decode_geometry(mine).positions(), decoded),
        "ours is larger": len(mine) <= 1.005 * len(theirs) + 2,
    }
    fault = "; ".join(name for name, fine in faults.items() if not fine)
    return Checked(len(mine), len(theirs), mine == theirs, fault)


def decoded(reference: Reference, turn: Turn, options: tuple[str, ...]) -> Checked:
    """Decode a stream of TMC3 with both."""
    known = tmc3_options(GpccOptions(**COMMON), turn.sensor)
    theirs = reference.encode(turn.points.astype(np.float64), 1, [*known, *options])
    same = equal(decode_geometry(theirs).positions(), reference.decode(theirs))
    return Checked(0, len(theirs), False, "" if same else "we decode TMC3's otherwise")


def turns(recordings: list[Path]) -> Iterator[Turn]:
    """Every cloud that is coded."""
    for name in SENSORS:
        yield virtual_turn(name)
    yield virtual_turn("vlp16", "none", 2)
    for path in recordings:
        for turn, _ in zip(recorded_turns(path), range(2), strict=False):
            yield turn
    yield from odd_turns()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("--recordings", nargs="+", type=Path, default=[])
    parser.add_argument("--turns", nargs="+", help="these alone, by name")
    parser.add_argument("--modes", nargs="+", help="these alone, by name")
    options = parser.parse_args()
    cases = failed = identical = coded = refused = 0
    with tempfile.TemporaryDirectory() as folder:
        reference = Reference(options.tmc3, Path(folder))
        for turn in turns(options.recordings):
            if options.turns and turn.name not in options.turns:
                continue
            for mode in options.modes or [*MODES, *DECODER_MODES]:
                try:
                    if mode in MODES:
                        found = checked(reference, turn, MODES[mode])
                    else:
                        found = decoded(reference, turn, DECODER_MODES[mode])
                except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
                    refused += 1
                    print(f"{turn.name}, {mode}: TMC3 failed ({type(error).__name__})", flush=True)
                    continue
                cases, failed = cases + 1, failed + bool(found.fault)
                coded, identical = coded + (found.ours > 0), identical + found.same
                said = found.fault or ("identical" if found.same else "the same points")
                sizes = f"{found.ours} / {found.reference} bytes"
                print(f"{turn.name}, {mode}: {sizes}, {said}", flush=True)
    print(f"{cases} cases, {identical} of {coded} byte-identical, {failed} failed", end="; ")
    print(f"TMC3 could not code {refused}")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
