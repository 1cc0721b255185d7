"""A run's result rows without Snakemake: the jobs of its plan, in this process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from puckbench.planning.workflow import Workflow
from puckbench.steps.step import PlannedStep
from puckbench.tables.registry import table_entry


def run_in_process(config: dict[str, Any]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The tables of all results and of all clouds of a configuration of samples and scans."""
    bench = Workflow(config)
    rows: list[Path] = []
    for dataset, cloud in bench.plan.clouds:
        prepared(bench, dataset, cloud)
        rows += [
            _coded(bench, dataset, cloud, codec)
            for codec in bench.plan.codecs
            if bench.plan.codes(codec, dataset)
        ]
    about = [
        bench.plan.results / "clouds" / dataset / f"{cloud}.json"
        for dataset, cloud in bench.plan.clouds
    ]
    return table_entry("metrics").make(rows), table_entry("clouds").make(about)


def prepared(flow: Workflow, dataset: str, cloud: str) -> Path:
    """The file of a prepared cloud, which is made."""
    files, results, data = flow.files, flow.plan.results, flow.plan.datasets[dataset]
    scene = Path(files.scene(dataset, cloud))
    source = Path(files.source(dataset, cloud))
    names = {"dataset": dataset, "cloud": cloud}
    if not scene.exists():
        _do(flow.step("scene", scene_set=data.scene_set, scene=scene.stem), scene=scene)
    if data.settings.is_scan:
        _do(flow.step("scan", **names), mesh=scene, table=source)
    else:
        _do(flow.step("sample", **names), mesh=scene, cloud=source)
    target = results / "clouds" / dataset / f"{cloud}.ply"
    made = {"cloud": target, "truth": Path(files.true_points(dataset, cloud))}
    rule = "prepare"
    if data.has_returns:
        rule, made["returns"] = "prepare_returns", target.with_suffix(".parquet")
    _do(flow.step(rule, **names), source=source, about=scene.with_suffix(".json"), **made)
    return target


def _coded(flow: Workflow, dataset: str, cloud: str, codec: str) -> Path:
    results, names = flow.plan.results, {"dataset": dataset, "cloud": cloud, "codec": codec}
    original = results / "clouds" / dataset / f"{cloud}.ply"
    curve = Path(flow.files.curve(**names))
    rows = results / "metrics" / dataset / cloud / f"{codec}.parquet"
    _do(flow.step("encode", **names), cloud=original, curve=curve)
    truth = {name: Path(file) for name, file in flow.files.truth(dataset, cloud).items()}
    _do(flow.step("evaluate", **names), cloud=original, **truth, curve=curve, rows=rows)
    return rows


def _do(planned: PlannedStep, **files: Any) -> None:
    settings = json.loads(planned.settings)
    type(planned.step).create(**settings).run(**files)
