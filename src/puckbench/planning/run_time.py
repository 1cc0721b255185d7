"""How long a run will take here: what its jobs took elsewhere, and a sample of this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from puckbench.planning.coding import Curve
from puckbench.planning.workflow import Workflow

SAMPLE_S = 0.2
"""Seconds of `machine_sample` on the machine where the numbers below were measured."""
_START_S = 1.5
"""Of a job's process, with imports and what is loaded once."""
_OF_CLOUDS = {"scene": 0.0, "sample": 1.0, "scan": 12.0, "prepare": 12.0, "scan_error": 12.0}
"""Seconds for each million points of jobs that make and measure clouds."""
_METRICS = {False: 1.0, True: 3.5}
"""Seconds for each million points of a measurement at one rate, without truth and with it."""
_OTHERS = {"residuals": 6.0, "wall_points": 1.0, "report_page": 8.0, "first_look": 4.0}
"""Seconds of other jobs, beyond the start of a process."""


def job_seconds(bench: Workflow) -> Callable[[str], float]:
    """What a job takes by the name of its rule, in seconds of the processor, elsewhere.

    Clouds differ: it is the mean over the configuration's, by the points that they should have.
    """
    counts = [data.points for data in bench.plan.datasets.values() for _ in data.clouds]
    millions = sum(counts) / 1e6 / max(1, len(counts))
    known = {name: per_million * millions for name, per_million in _OF_CLOUDS.items()} | _OTHERS
    known |= _of_curves(bench, millions)
    return lambda rule: _START_S + known.get(rule, 0.5)


def _of_curves(bench: Workflow, millions: float) -> dict[str, float]:
    """Seconds of jobs that code, decode and measure curves."""
    coding, points = bench.coding, int(millions * 1e6)
    truth = any(data.has_truth for data in bench.plan.datasets.values())
    found = {}

    def calls(curve: Curve, repeats: int) -> float:
        """Encoding and decoding take about as long as each other."""
        return len(curve.rates) * repeats * coding.pace(curve.codec).of(points) / 2

    for curve in coding.curves:
        coded = calls(curve, coding.timing.repeats)
        measured = coded + len(curve.rates) * _METRICS[truth] * millions
        found[curve.name("encode")] = coded
        for suffix in ("", "_surfaces"):
            found[curve.name("evaluate") + suffix] = measured
    for curve in (*coding.shown, *coding.not_shown):
        found[curve.name("decode")] = calls(curve, 1)
    return found


def machine_sample() -> float:
    """Seconds of a little work like that of the jobs, on one core, beside what else runs here."""
    import numpy as np

    values = np.random.default_rng(0).random((100_000, 3))
    best = np.inf
    for _ in range(3):
        start = time.perf_counter()
        for axis in range(3):
            np.argsort(values[:, axis], kind="stable")
        sum(number * number for number in range(400_000))
        best = min(best, time.perf_counter() - start)
    return float(best)


def run_seconds(
    jobs: Mapping[str, int], seconds: Callable[[str], float], cores: int, sample_s: float
) -> float:
    """Seconds that jobs (rule -> how many) take on some cores of the machine with that sample."""
    work = sum(count * seconds(rule) for rule, count in jobs.items())
    return work * sample_s / SAMPLE_S / max(1, cores)
