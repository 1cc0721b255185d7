"""A run's result rows without Snakemake: the jobs of its plan, in this process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from puckbench.jobs.registry import JOBS
from puckbench.planning.planned_job import PlannedJob
from puckbench.planning.workflow import Workflow
from puckbench.tables.registry import table_entry


def run_in_process(config: dict[str, Any]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The tables of all results and of all clouds of a configuration of samples and scans."""
    bench = Workflow(config)
    rows: list[Path] = []
    for dataset, cloud in bench.plan.clouds:
        _prepare(bench, dataset, cloud)
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


def _prepare(bench: Workflow, dataset: str, cloud: str) -> None:
    jobs, results = bench.clouds, bench.plan.results
    scene = Path(jobs.scene_file(dataset, cloud))
    source = Path(jobs.source(dataset, cloud))
    target = results / "clouds" / dataset / f"{cloud}.ply"
    if not scene.exists():
        _do(jobs.scene(jobs.dataset(dataset).scenes, scene.stem), scene=scene)
    if jobs.dataset(dataset).settings.is_scan:
        _do(jobs.scan(dataset, cloud), mesh=scene, table=source)
    else:
        _do(jobs.sample(dataset, cloud), mesh=scene, cloud=source)
    about = scene.with_suffix(".json")
    more = {"box": about} if jobs.is_cropped(dataset) else {}
    if jobs.dataset(dataset).has_returns:
        more["returns"] = target.with_suffix(".parquet")
    truth = Path(jobs.true_points(dataset, cloud))
    _do(jobs.prepare(dataset), source=source, cloud=target, truth=truth, about=(about,), **more)


def _coded(bench: Workflow, dataset: str, cloud: str, codec: str) -> Path:
    coding, results = bench.coding, bench.plan.results
    original = results / "clouds" / dataset / f"{cloud}.ply"
    curve = results / "coded" / dataset / cloud / f"{codec}.zip"
    rows = results / "metrics" / dataset / cloud / f"{codec}.parquet"
    _do(coding.encode(dataset, cloud, codec), cloud=original, curve=curve)
    truth = {name: Path(file) for name, file in coding.truth(dataset, cloud).items()}
    _do(coding.evaluate(dataset, cloud, codec), cloud=original, **truth, curve=curve, rows=rows)
    return rows


def _do(job: PlannedJob, **files: Any) -> None:
    JOBS.get(job.name).create(**json.loads(job.record)).run(**files)
