"""Distance to the true surface of scans, of `puck` and of `puck_smoothed`, by rate and by place.

    python -m benchmarks.ablations.puck_smoothed [--scenes office_1 street_1 ...]
        [--sensors vlp16 ...] [--errors vlp16 ...] [--places] [--without-biases]

One turn at 10 Hz of each scene under each error model. For each rate: bits per return, and in mm
`truth_d1_rms_m` and `truth_d2_rms_m` of both from one stream; first those of the scan itself. Then
the seconds of the processor that smoothing takes. With --places instead, at the given rate, the
root of the mean squared distance from a decoded point to the surface's plane there (range error
times cosine of incidence, at most 0.3 m) of scan | puck -> puck_smoothed, by kind of place: `edge`,
where the true range jumps by more than 0.2 m to a return beside it in its row; otherwise the
greatest incidences; otherwise the classes of objects.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.registry import open_codec
from puckbench.core.seeding import generator
from puckbench.datasets.registry import LOADERS
from puckbench.geometry.cloud import PointCloud
from puckbench.geometry.mesh import Mesh
from puckbench.lidar import free_origin, load_sensor, open_error_model, open_sweep
from puckbench.lidar.returns import Returns
from puckbench.lidar.scan import scan
from puckbench.lidar.scan_returns import ScanReturns, returns_of_scan, true_points
from puckbench.lidar.scan_table import ScanTable
from puckbench.metrics.truth import Truth
from puckbench.puck import smoothing

SWEEP = {
    "preset": "spin",
    "timing": "firing",
    "rotation_hz": 10,
    "frames_per_second": 10,
    "duration_s": 0.1,
}
RATES = ("200mm", "100mm", "50mm", "20mm", "10mm", "4mm")


class Turned(NamedTuple):
    """A scan of one turn."""

    mesh: Mesh
    table: ScanTable
    found: ScanReturns

    @property
    def returns(self) -> Returns:
        return self.found.returns


def turned(name: str, sensor: str, errors: str) -> Turned:
    """Scan a generated room or street."""
    scene = LOADERS.get("street" if name.startswith("street") else "embedded_rooms")().load(name)
    assert scene.mesh is not None
    origin = free_origin(scene.mesh, 1.3) if scene.origin is None else scene.origin
    model, rng = open_error_model(errors, {}), generator(0, "scan", name)
    table = scan(scene.mesh, load_sensor(sensor), open_sweep(SWEEP), model, origin, rng)
    return Turned(scene.mesh, table, returns_of_scan(table))


def told(truth: Truth, points: NDArray) -> str:
    """Distances of points to the true surface."""
    found = truth.metrics(points)
    return " ".join(f"{1000 * found[f'truth_{key}_rms_m']:6.2f}" for key in ("d1", "d2"))


def rates(turn: Turned) -> None:
    """Print a line for each rate."""
    table, found = turn.table, turn.found
    normals = table.normals[found.rows]
    seen = PointCloud(true_points(table, found), normals=normals)
    about = {"offset": tuple(table.about["origin"])}
    reference = PointCloud(turn.returns.points(), about=about)
    truth = Truth(reference, turn.mesh, seen)
    smoothed = open_codec("puck_smoothed")
    plain = open_codec("puck", {"options": {"lmbda": smoothed.options.lmbda}})
    plain.metric_rates = smoothed.metric_rates
    smoothed.load()
    print(f"    scan: {told(truth, reference.xyz)} mm")
    for rate in RATES:
        coded = plain.encode_returns(turn.returns, rate)
        stream = smoothed.encode_returns(turn.returns, rate)
        start = time.process_time()
        exact = plain.decode(coded)
        middle = time.process_time()
        better = smoothed.decode(stream)
        seconds = time.process_time() - middle - (middle - start)
        bits = 8 * len(stream) / len(turn.returns)
        both = f"{told(truth, exact)} -> {told(truth, better)} mm"
        print(f"    {rate:>5} {bits:.2f} bits: {both}; {seconds:.3f} s", flush=True)


def places(turn: Turned, rate: str) -> None:
    """Print a line for each kind of place."""
    table, rows = turn.table, turn.found.rows
    image = turn.returns.turns[0].ranges[0]
    columns, lasers = np.nonzero(image)
    true = np.full(image.shape, np.nan)
    true[columns, lasers] = table["distance"][rows]
    jumps = np.abs(np.diff(true, axis=0, append=true[:1])) > 0.2
    edge = (jumps | np.roll(jumps, 1, axis=0))[columns, lasers]
    steep = np.degrees(table["incidence"][rows])
    objects = turn.mesh.labels.objects if turn.mesh.labels else ()
    names = np.array([*(one.semantic for one in objects), "other"])
    kind = names[table["object_id"][rows]]
    kind = np.where(edge, "edge", np.where(steep > 80, "over 80 degrees", kind))
    lengths = []
    lmbda = open_codec("puck_smoothed").options.lmbda
    for name in ("puck", "puck_smoothed"):
        codec = open_codec(name, {"options": {"lmbda": lmbda}})
        cloud = codec.decode_cloud(codec.encode_returns(turn.returns, rate))
        lengths.append(np.linalg.norm(cloud.xyz, axis=1))
    lengths.append(np.linalg.norm(turn.returns.points(), axis=1))
    cosine = np.cos(table["incidence"][rows])
    errors = [np.clip(each - table["distance"][rows], -0.3, 0.3) * cosine for each in lengths]
    for one in ["edge", "over 80 degrees", *sorted({*kind} - {"edge", "over 80 degrees"})]:
        chosen = kind == one
        if np.count_nonzero(chosen) >= 50:
            rms = [1000 * np.sqrt(np.mean(each[chosen] ** 2)) for each in errors]
            share = 100 * np.mean(chosen)
            print(f"    {one:18} {share:5.1f} %: {rms[2]:6.1f} | {rms[0]:6.1f} -> {rms[1]:6.1f} mm")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=["office_1", "street_1"])
    parser.add_argument("--sensors", nargs="+", default=["vlp16"])
    parser.add_argument("--errors", nargs="+", default=["vlp16"])
    parser.add_argument("--places", metavar="RATE")
    parser.add_argument("--without-biases", action="store_true")
    options = parser.parse_args()
    if options.without_biases:
        smoothing._biases = lambda image, planes, std: np.zeros(len(image.ranges))
    for scene in options.scenes:
        for sensor in options.sensors:
            for errors in options.errors:
                print(f"{scene}, {sensor}, {errors}", flush=True)
                turn = turned(scene, sensor, errors)
                if options.places:
                    places(turn, options.places)
                else:
                    rates(turn)


if __name__ == "__main__":
    main()
