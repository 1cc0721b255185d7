"""Coverage of a calibration's 95 % intervals: how often they hold the parameters of hidden models.

    python -m benchmarks.checks.calibration_recovery [--repetitions 100]
        [--hidden device frames] [--out F]

Each repetition scans walls and floors (thesis Procedure 1, coarse sweep, RANSAC planes as PCL fits
them) with the error model, another device and other noise each time, calibrates on the residuals
alone, and asks of every parameter whether the interval holds the hidden value. Of the lasers'
biases it counts all intervals of all lasers.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from jenco2022.residuals.virtual import SWEEP, Procedure, residual_table
from pointkit.files import write_json
from pointkit.seeding import generator
from virtual_lidar import Calibration, CalibrationOptions, Estimate, calibrate

# The parameters of hidden models: `device` has a bias of every kind, as real sensors seem to;
# `frames` is vlp16_incidence with biases per frame alone, and Laplace noise.
HIDDEN: dict[str, dict[str, Any]] = {
    "device": {
        "laser_sigma_m": 0.008,
        "scan_sigma_m": 0.003,
        "frame_sigma_m": 0.002,
        "ray_sigma_m": 0.006,
        "ray_incidence_m": 0.002,
        "ray_range": 0.0002,
        "range_mean_m": 0.005,
    },
    "frames": {
        "laser_sigma_m": 0.0,
        "scan_sigma_m": 0.0,
        "frame_sigma_m": 0.014,
        "ray_sigma_m": 0.010,
        "ray_incidence_m": 0.010,
        "ray_range": 0.0,
        "range_mean_m": 0.0,
        "ray_distribution": "laplace",
    },
}
DISTANCES, LASERS = (1.0, 3.0, 5.0), 16


def repeated(hidden: str, repetition: int, step_deg: float) -> tuple[Calibration, dict[str, Any]]:
    """A calibration of one device on its own scans, and the device's parameters."""
    rng = generator(repetition, "recovery", hidden)
    truth = dict(HIDDEN[hidden])
    # Given as numbers, so that what is hidden is known.
    truth["bias_m"] = (rng.standard_normal(LASERS) * truth["laser_sigma_m"]).tolist()
    procedure = Procedure("calibrated", truth, sweep=SWEEP.replaced(azimuth_step_deg=step_deg))
    table = residual_table(procedure, DISTANCES, 1, seed=repetition)
    return calibrate([table], CalibrationOptions()), truth


def held(found: Calibration, truth: dict[str, Any]) -> Counter[str]:
    bias = np.array(truth["bias_m"])
    counts = Counter({name: _holds(one, truth[name]) for name, one in found.sigmas.items()})
    assert found.mean is not None
    counts["range_mean_m"] = _holds(found.mean, truth["range_mean_m"] + bias.mean())
    inside = [_holds(*pair) for pair in zip(found.biases, bias - bias.mean(), strict=True)]
    counts["bias_m"] = sum(inside)
    return counts


def _holds(one: Estimate, value: float) -> int:
    return int(one.low - 1e-12 <= value <= one.high + 1e-12)


def coverage(hidden: str, repetitions: int, step_deg: float) -> dict[str, Any]:
    """Counts over all repetitions, mean estimates, and the time of a calibration."""
    counts: Counter[str] = Counter()
    estimates: dict[str, list[float]] = {}
    started = time.perf_counter()
    for repetition in range(repetitions):
        found, truth = repeated(hidden, repetition, step_deg)
        counts += held(found, truth)
        for name, one in found.sigmas.items():
            estimates.setdefault(name, []).append(asdict(one)["value"])
        print(hidden, repetition + 1, dict(counts), flush=True)
    return {
        "hidden": HIDDEN[hidden],
        "repetitions": repetitions,
        "residuals": found.counts["residuals"],
        "inside": {name: counts[name] for name in (*found.sigmas, "range_mean_m")},
        "biases_inside": counts["bias_m"],
        "biases": repetitions * LASERS,
        "mean_estimates": {name: float(np.mean(each)) for name, each in estimates.items()},
        "seconds_each": (time.perf_counter() - started) / repetitions,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=100)
    parser.add_argument("--hidden", nargs="+", choices=list(HIDDEN), default=list(HIDDEN))
    parser.add_argument("--step-deg", type=float, default=1.0, help="azimuth step of the sweep")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    results = {
        name: coverage(name, options.repetitions, options.step_deg) for name in options.hidden
    }
    print(json.dumps(results, indent=1))
    if options.out is not None:
        write_json(options.out, results)


if __name__ == "__main__":
    main()
