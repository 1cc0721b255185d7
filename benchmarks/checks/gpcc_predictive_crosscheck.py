"""Predictive geometry against the reference software, both ways, over sensors and options.

    python -m benchmarks.checks.gpcc_predictive_crosscheck TMC3 [--recordings PATH ...]
        [--turns NAME ...] [--modes NAME ...]

For each turn of a virtual sensor, of the recordings, and for clouds that no sensor measures, under
each set of options: what TMC3 decodes from our stream must be what we decode from it, and without
loss the points that were coded; what we decode from TMC3's stream must be what TMC3 decodes from
it; and our stream may be at most 0.5 % larger. Options that only a decoder knows (slices, axis
orders, bypass) are checked on TMC3's streams alone. What TMC3 itself cannot code is counted apart.
Exit status 1 if any case fails.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.turns import SENSORS, Turn, odd_turns, recorded_turns, virtual_turn

from puckbench.codecs.external.program import write_points
from puckbench.codecs.gpcc.coder import decode_geometry
from puckbench.codecs.gpcc.predictive_coder import PredictiveOptions, encode_predictive
from puckbench.codecs.gpcc.sensor import SensorDescription
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.io.clouds import read_cloud

SECONDS, MEMORY = 30, 2**31
"""That one of TMC3's processes may take: slices of a flat cloud have it search for ever."""
AS_TMC3: dict[str, Any] = {"slice_qp_interval_log2": 0}
"""TMC3's default for slices differs from its default for streams."""
LOSSY = (1, 12), (2, 11), (4, 9), (5, 8), (7, 7), (8, 7)
"""Steps of radius and azimuth (powers of two) of MPEG's conditions."""

MODES: dict[str, dict[str, Any]] = {
    "sensor": {},
    "sensor, merged": {"merge_duplicates": True},
    "sensor, as given": {"order": "given"},
    "sensor, Morton": {"order": "morton"},
    "sensor, radius": {"order": "radius"},
    "sensor, exact azimuth": {"azimuth_sort_precision": 0.0},
    "sensor, angles": {"azimuth_scaling": False},
    "sensor, short trees": {"tree_max_points": 700},
    "sensor, QP 3": {"base_qp": 3},
    **{
        f"sensor, radius {radius}": {
            "radius_inv_scale_log2": radius,
            "azimuth_scale_log2": azimuth,
            "base_qp": 58,
        }
        for radius, azimuth in LOSSY
    },
    "azimuth": {"angular": False},
    "azimuth, coarse": {"angular": False, "azimuth_sort_precision": 8.0},
    "Morton": {"angular": False, "order": "morton"},
    "as given": {"angular": False, "order": "given"},
    "radius": {"angular": False, "order": "radius"},
    "Morton, merged": {"angular": False, "order": "morton", "merge_duplicates": True},
    "short trees": {"angular": False, "tree_max_points": 700},
    "QP 21": {"angular": False, "base_qp": 21},
    "QP 12, doubled": {"angular": False, "base_qp": 12, "qp_multiplier_log2": 1},
}
"""Changes of our options by the name of a mode; angular: with the sensor."""

DECODER_MODES: dict[str, tuple[str, ...]] = {
    "slices": ("--partitionMethod=4", "--sliceMaxPoints=1500", "--sliceMinPoints=500"),
    "slices continued": (
        *("--partitionMethod=4", "--sliceMaxPoints=1500", "--sliceMinPoints=500"),
        "--entropyContinuationEnabled=1",
    ),
    "bypass": ("--cabac_bypass_stream_enabled_flag=1",),
    "zyx": ("--geometry_axis_order=0",),
    "yzx": ("--geometry_axis_order=5",),
    "tiles": ("--tileSize=4096",),
    "slice QP": ("--positionQuantisationEnabled=1", "--positionSliceQpOffset=9"),
}
"""Options of TMC3 that our encoder does not have."""

ORDERS = {"given": 0, "morton": 1, "azimuth": 2, "radius": 3}


class Checked(NamedTuple):
    """One case: bytes of both (0: none), and what is wrong."""

    ours: int
    reference: int
    same: bool
    fault: str


def tmc3_options(options: PredictiveOptions, sensor: SensorDescription | None) -> list[str]:
    """Our options by the names of TMC3, and the sensor."""
    named: dict[str, Any] = {
        "geomTreeType": 1,
        "mergeDuplicatedPoints": int(options.merge_duplicates),
        "predGeomSort": ORDERS[options.order],
        "predGeomAzimuthSortPrecision": options.azimuth_sort_precision,
        "predGeomTreePtsMax": options.tree_max_points,
        "partitionMethod": 0,
    }
    if options.base_qp is not None:
        named |= {
            "positionQuantisationEnabled": 1,
            "positionBaseQp": options.base_qp,
            "positionQpMultiplierLog2": options.qp_multiplier_log2,
        }
    if sensor is not None:
        lasers = sorted(zip(sensor.tan_elevation, sensor.height, strict=True))
        turn = 1 << (12 + options.azimuth_scale_log2)
        named |= {
            "positionAzimuthScaleLog2": options.azimuth_scale_log2,
            "positionAzimuthSpeed": round(turn / sensor.steps_per_turn),
            "positionRadiusInvScaleLog2": options.radius_inv_scale_log2,
            "predGeomAzimuthQuantization": int(options.azimuth_scaling),
            "angularEnabled": 1,
            "numLasers": len(lasers),
            "lasersTheta": ",".join(repr(tan) for tan, _ in lasers),
            "lasersZ": ",".join(repr(-height) for _, height in lasers),
            "lasersNumPhiPerTurn": ",".join([str(sensor.steps_per_turn)] * len(lasers)),
            "lidarHeadPosition": ",".join(map(str, sensor.position)),
        }
    return [f"--{name}={value}" for name, value in named.items()]


class Reference:
    """TMC3 on files in a folder; `said` is what it printed last."""

    said: str = ""

    def __init__(self, program: str, folder: Path) -> None:
        self._program, self._folder = program, folder

    def encode(self, points: Floats, options: list[str]) -> bytes:
        """The stream of points, whole numbers."""
        write_points(self._folder / "in.ply", points, "float64")
        source = f"--uncompressedDataPath={self._folder / 'in.ply'}"
        self._run("--mode=0", "--disableAttributeCoding=1", source, *options)
        return (self._folder / "stream.bin").read_bytes()

    def decode(self, stream: bytes) -> Floats:
        """The points of a stream."""
        (self._folder / "stream.bin").write_bytes(stream)
        out = self._folder / "out.ply"
        self._run("--mode=1", "--outputBinaryPly=1", f"--reconstructedDataPath={out}")
        return read_cloud(out).xyz

    def _run(self, *options: str) -> None:
        command = [self._program, f"--compressedStreamPath={self._folder / 'stream.bin'}", *options]
        ran = subprocess.run(
            command,
            check=True,
            capture_output=True,
            timeout=SECONDS,
            text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
        )
        self.said = ran.stdout


def equal(a: Floats, b: Floats) -> bool:
    return np.array_equal(a[np.lexsort(a.T)], b[np.lexsort(b.T)])


def checked(reference: Reference, turn: Turn, changes: dict[str, Any]) -> Checked:
    """Code with both, decode each stream with both."""
    known = {**AS_TMC3, **changes}
    sensor = turn.sensor if known.pop("angular", True) else None
    options = PredictiveOptions(**known)
    points = turn.points.astype(np.float64)
    if sensor is None:  # the reference orders by azimuth around the origin of the coordinates
        points -= turn.sensor.position
    theirs = reference.encode(points, tmc3_options(options, sensor))
    mine = encode_predictive(points.astype(np.int64), options, sensor)
    decoded = decode_geometry(mine).positions()
    faults = {
        "TMC3 decodes ours otherwise": equal(reference.decode(mine), decoded),
        "we decode TMC3's otherwise": equal(
            decode_geometry(theirs).positions(), reference.decode(theirs)
        ),
        "ours is larger": len(mine) <= 1.005 * len(theirs) + 2,
    }
    if options.base_qp is None:
        kept = np.unique(points, axis=0) if options.merge_duplicates else points
        faults["points are lost"] = equal(decoded, kept)
    fault = "; ".join(name for name, fine in faults.items() if not fine)
    return Checked(len(mine), len(theirs), mine == theirs, fault)


def decoded(reference: Reference, turn: Turn, options: tuple[str, ...]) -> Checked:
    """Decode a stream of TMC3 with both."""
    known = tmc3_options(PredictiveOptions(), turn.sensor)
    theirs = reference.encode(turn.points.astype(np.float64), [*known, *options])
    same = equal(decode_geometry(theirs).positions(), reference.decode(theirs))
    return Checked(0, len(theirs), False, "" if same else "we decode TMC3's otherwise")


def turns(recordings: list[Path]) -> Iterator[Turn]:
    """Every cloud that is coded."""
    for name in SENSORS:
        yield virtual_turn(name, step_deg=0.5)
    yield virtual_turn("vlp16", "none", 2, 0.8)
    for path in recordings:
        yield next(recorded_turns(path))
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
                where = f"{turn.name}, {mode}"
                try:
                    if mode in MODES:
                        found = checked(reference, turn, MODES[mode])
                    else:
                        found = decoded(reference, turn, DECODER_MODES[mode])
                except (subprocess.SubprocessError, InputError) as error:
                    refused += 1
                    print(f"{where}: {str(error).rpartition(']')[2].strip()}", flush=True)
                    continue
                cases, failed = cases + 1, failed + bool(found.fault)
                coded, identical = coded + (found.ours > 0), identical + found.same
                said = found.fault or ("identical" if found.same else "the same points")
                print(f"{where}: {found.ours} / {found.reference} bytes, {said}", flush=True)
    print(f"{cases} cases, {identical} of {coded} byte-identical, {failed} failed", end="; ")
    print(f"not coded: {refused}")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
