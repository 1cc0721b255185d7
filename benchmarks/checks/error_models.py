"""Which error model is worth it: networks trained under each, measured on real scans.

    python -m benchmarks.checks.error_models RESULTS

reads the model cards of the trainings of config/perception_errors.yaml, and prints the mean mIoU of
each error model over the seeds on each data set, with its interval of 95 % (Student's t), and the
difference from the model `none` with the same seeds.
"""

import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy import stats

from pointkit.errors import InputError
from pointkit.files import read_json

BASE = "none"
Scores = Mapping[str, Mapping[str, Mapping[int, float]]]
"""Mean IoU by data set, error model and seed."""


def scores(folder: Path) -> Scores:
    """Return the scores in the cards ``NAME-SEED.json`` of a folder."""
    found: dict[str, dict[str, dict[int, float]]] = defaultdict(lambda: defaultdict(dict))
    for path in sorted(folder.glob("*-*.json")):
        model, _, seed = path.stem.rpartition("-")
        for dataset, values in read_json(path)["validation"].items():
            found[dataset][model][int(seed)] = values["miou"]
    return found


def interval(values: list[float]) -> str:
    """Return a mean with half of its interval of 95 %, or the mean alone of a single value."""
    mean = float(np.mean(values))
    if len(values) < 2:
        return f"{mean:.3f}"
    half = stats.t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values))
    return f"{mean:.3f} ± {half:.3f}"


def table(found: Scores) -> str:
    """Return the scores as a Markdown table."""
    rows = ["| data set | error model | seeds | mIoU | minus `none` |", "|---|---|---|---|---|"]
    for dataset, models in found.items():
        for model, values in models.items():
            paired = [value - models[BASE][seed] for seed, value in values.items()
                      if seed in models.get(BASE, {})]  # fmt: skip
            less = "" if model == BASE or not paired else interval(paired)
            mean = interval(list(values.values()))
            rows.append(f"| {dataset} | `{model}` | {len(values)} | {mean} | {less} |")
    return "\n".join(rows)


if __name__ == "__main__":
    (where,) = map(Path, sys.argv[1:])
    cards = scores(where / "segmentation")
    if not cards:
        raise SystemExit(str(InputError(f"{where / 'segmentation'}: no cards of trainings")))
    print(table(cards))
