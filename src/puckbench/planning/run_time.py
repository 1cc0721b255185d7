from __future__ import annotations

from collections.abc import Callable

from puckbench.planning.costs import costs_of
from puckbench.planning.workflow import Workflow

_START_S = 0.15
"""Estimated time, in s, to start the process of a job."""
_OF_CLOUDS = {"scene": 0.0, "sample": 1.0, "scan": 12.0, "prepare": 12.0, "scan_error": 6.0}
"""Estimated time, in s per million points, of jobs of these rules on one cloud."""
_METRICS = {False: 1.0, True: 2.0}
"""Estimated time, in s per million points, to measure one rate; True: with a true surface."""
_OTHERS = {"residuals": 2.5, "wall_points": 0.8, "report_page": 10.0, "first_look": 2.0}
"""Estimated time, in s, of jobs of these rules, which does not depend on the clouds."""
_OTHER_S = 1.0
"""Estimated time, in s, of any other job, such as a figure or table."""


def job_seconds(bench: Workflow) -> Callable[[str], float]:
    """Return a function that estimates how long a job of the workflow takes.

    The function takes the name of the job's rule, and returns the estimated mean time in s.
    """
    counts = [data.points for data in bench.plan.datasets.values() for _ in data.clouds]
    millions = sum(counts) / 1e6 / max(1, len(counts))
    seconds = {name: per_million * millions for name, per_million in _OF_CLOUDS.items()} | _OTHERS
    seconds |= _of_curves(bench, millions)
    return lambda rule: _START_S + seconds.get(rule, _OTHER_S)


def _of_curves(bench: Workflow, millions: float) -> dict[str, float]:
    plan, points = bench.plan, int(millions * 1e6)
    repeats = plan.config.timing.repeats
    truth = any(data.has_truth for data in plan.datasets.values())
    encoded = decoded = number = 0.0
    for dataset, _, codec in plan.curves:
        costs = costs_of(plan.opened[codec])
        rates = len(plan.rates(codec, plan.datasets[dataset].frame)) / len(plan.curves)
        encoded += rates * costs.seconds_of(points) * costs.encoding
        decoded += rates * costs.seconds_of(points) * (1 - costs.encoding)
        number += rates
    shown = min(1.0, plan.config.report.rates / max(1.0, number))
    return {
        "encode": repeats * encoded,
        "evaluate": repeats * decoded + number * _METRICS[truth] * millions,
        "decode_shown": shown * decoded,
        "recovery": decoded,
    }
