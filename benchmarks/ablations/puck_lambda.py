"""What rate-distortion optimisation of ranges saves: `puck` by lambda, at equal error.

    python -m benchmarks.ablations.puck_lambda [RECORDING...] [--scenes office_1 street_1 ...]
        [--sensors vlp16 ...] [--errors vlp16 ...] [--lambdas 0.05 0.1 ...]

For the turns of each recording (of two returns the strongest) and one turn of each scene, for each
rate and lambda (squared steps a nat): bits per return, D1 in mm^2 (the larger mean of both
directions), and the bits as a share of those that lambda 0 takes at that D1, interpolated between
steps. For scenes also `truth_d1_rms_m` of `puck_smoothed` in mm, and as a share of that of lambda 0
at equal bits. Last the means of the shares of each lambda, and the largest share.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from benchmarks.ablations.puck_smoothed import Turned, turned
from scipy.spatial import cKDTree

from puckbench.codecs.puck import Puck
from puckbench.codecs.puck_smoothed import PuckSmoothed
from puckbench.geometry.cloud import PointCloud
from puckbench.lidar.recordings.packet_turns import returns_of_packets
from puckbench.lidar.recordings.reading import read_packets
from puckbench.lidar.returns import Returns
from puckbench.lidar.scan_returns import true_points
from puckbench.lidar.turns import Layout, Turn
from puckbench.metrics.truth import Truth

RATES_MM = (4, 10, 20, 50, 100, 200)
BETWEEN_MM = (6, 8, 14, 28, 36, 70, 140, 280, 400)
"""Steps that are coded with lambda 0 alone."""


def strongest(path: Path) -> Returns:
    """The returns of a recording; of two of a beam the strongest."""
    found = returns_of_packets(read_packets(path).payloads)
    layout = Layout(
        found.layout.order, found.layout.columns_per_block, found.layout.blocks_per_time
    )
    return replace(
        found,
        layout=layout,
        turns=tuple(Turn(turn.ranges[:1], turn.azimuths) for turn in found.turns),
    )


def d1(returns: Returns, decoded: Returns) -> float:
    """Mean squared distance to the nearest point, mm^2: the larger mean of both directions."""
    errors = []
    for one, other in zip(returns.split(), decoded.split(), strict=True):
        a, b = one.points(), other.points()
        there, back = cKDTree(b).query(a)[0], cKDTree(a).query(b)[0]
        errors.append(max(np.mean(there**2), np.mean(back**2)))
    return 1e6 * float(np.mean(errors))


def truth_of(turn: Turned) -> Truth:
    """The true surface of a scan."""
    table, found = turn.table, turn.found
    seen = PointCloud(true_points(table, found), normals=table.normals[found.rows])
    about = {"offset": tuple(table.about["origin"])}
    return Truth(PointCloud(turn.returns.points(), about=about), turn.mesh, seen)


def curves(
    returns: Returns, truth: Truth | None, lambdas: list[float]
) -> dict[float, dict[int, tuple[float, float, float]]]:
    """Bits per return, D1 and distance to the truth, by lambda and step in mm."""
    curves: dict[float, dict[int, tuple[float, float, float]]] = {}
    for lmbda in (0.0, *lambdas):
        plain, smoothed = Puck("puck", lmbda=lmbda), PuckSmoothed("puck_smoothed", lmbda=lmbda)
        steps = RATES_MM if lmbda else sorted((*RATES_MM, *BETWEEN_MM))
        curves[lmbda] = {}
        for step in steps:
            quanta = max(1, round(step / 1000 / returns.quantum_m))
            stream = plain._stream(returns, quanta)
            bits = 8 * len(stream) / len(returns)
            error = d1(returns, plain.decode_returns(stream))
            away = np.nan
            if truth is not None:
                points = smoothed.decode_cloud(smoothed._stream(returns, quanta)).xyz
                away = 1000 * truth.metrics(points)["truth_d1_rms_m"]
            curves[lmbda][step] = bits, error, away
    return curves


class Shares(NamedTuple):
    """By lambda and step: bits at equal D1, and distances to the truth at equal bits, over those
    of lambda 0."""

    bits: dict[tuple[float, int], list[float]]
    truth: dict[tuple[float, int], list[float]]


def compare(found: dict[float, dict[int, tuple[float, float, float]]], shares: Shares) -> None:
    """Print a line for each rate, and keep the shares."""
    bits, error, away = np.array(list(found[0.0].values())).T
    for step in RATES_MM:
        told = [f"{step:4} mm"]
        for lmbda, curve in found.items():
            b, e, w = curve[step]
            share = b / np.exp(np.interp(np.log(e), np.log(error), np.log(bits)))
            shares.bits[lmbda, step].append(share)
            told.append(f"{lmbda:g}: {b:.3f} {e:8.2f} ({share:.3f})")
            if np.isfinite(w):
                share = w / np.exp(np.interp(-b, -bits, np.log(away)))
                shares.truth[lmbda, step].append(share)
                told.append(f"{w:.1f} ({share:.3f})")
        print(" ".join(told), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="*")
    parser.add_argument("--scenes", nargs="*", default=["office_1", "street_1"])
    parser.add_argument("--sensors", nargs="+", default=["vlp16"])
    parser.add_argument("--errors", nargs="+", default=["vlp16"])
    parser.add_argument("--lambdas", nargs="+", type=float, default=[0.002, 0.02, 0.05, 0.1])
    options = parser.parse_args()
    shares = Shares(defaultdict(list), defaultdict(list))
    for path in options.recordings:
        print(path.name)
        compare(curves(strongest(path), None, options.lambdas), shares)
    for each in product(options.scenes, options.sensors, options.errors):
        print(", ".join(each))
        turn = turned(*each)
        compare(curves(turn.returns, truth_of(turn), options.lambdas), shares)
    for kind, every in (("bits at equal D1", shares.bits), ("truth at equal bits", shares.truth)):
        for (lmbda, step), values in sorted(every.items()):
            mean, most = np.mean(values), max(values)
            print(f"{kind}, lambda {lmbda:g}, {step} mm: {mean:.3f}, at most {most:.3f}")


if __name__ == "__main__":
    main()
