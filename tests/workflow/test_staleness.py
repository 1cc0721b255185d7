"""A job runs again if and only if its inputs, parameters or code change: for every kind of job."""

from __future__ import annotations

import csv
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

from puckbench.planning.fingerprints import covered, data_files
from puckbench.planning.planned_job import PlannedJob
from puckbench.planning.workflow import Workflow
from tests.support.bench import ROOT, Bench
from tests.support.every_job import CODEC, CONFIG, SOURCES, jobs_of
from tests.support.traced_jobs import Traced

TARGETS = [
    *("tables", "train", "results/residuals/calibrated.yaml", "results/reference.parquet"),
    *("results/decoded/sampled/chair_01/draco/r8.ply", "results/first_look/metrics.parquet"),
    "results/decoded/sampled/chair_01/draco.zip",
    *(f"results/figures/{name}.png" for name in ("fig_5_1", "fig_5_10", "fig_6_5", "truth_rd")),
]
ONCE = {"table", "evaluate_curve", "encode_curve"}
"""Jobs of which all are traced, not one of each kind."""
OF_EVERY_JOB = {
    *("core/compiling.py", "core/environment.py", "core/imports.py", "core/lazy.py"),
    *("core/registry.py", "core/yaml_files.py"),
    *("jobs/cost.py", "jobs/process.py", "jobs/registry.py"),
}
"""Code that finds and starts jobs, or measures them: it changes no result."""
IN_PARAMETERS = {
    *("codecs/variants.yaml", "learned/weights", "report/assets"),
    *("lidar/sensors", "lidar/errors/calibrations"),
}
"""Data whose content, or whose digest, is among the parameters of the jobs that read them."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A folder with the configuration of every kind of job."""
    bench = Bench(tmp_path_factory.mktemp("staleness"))
    bench.capture(5)
    (bench.folder / "mine.py").write_text(CODEC)
    points = "".join(f"{k % 7},{k % 11},{k % 13}\n" for k in range(300))
    (bench.folder / "points.csv").write_text(f"x,y,z\n{points}")
    (bench.folder / "path.csv").write_text("0,0,0,1,0,0,0\n0.3,0.2,0,1,0,0,0\n")
    poses = "".join(f"1 0 0 {k} 0 1 0 0 0 0 1 0\n" for k in range(3))
    (bench.folder / "poses.txt").write_text(poses)
    (bench.folder / "config.yaml").write_text(yaml.safe_dump(CONFIG, sort_keys=False))
    return bench


@pytest.fixture(scope="module")
def jobs(bench: Bench) -> dict[str, PlannedJob]:
    """The jobs of the configuration, by name."""
    with pytest.MonkeyPatch.context() as place:
        place.chdir(bench.folder)
        return jobs_of(Workflow(yaml.safe_load(Path("config.yaml").read_text())))


def code_of(job: PlannedJob) -> set[str]:
    """The files of a job's code, relative to the package where they lie in it."""
    modules = covered(*job.modules)
    files = {*modules, *(data for module in modules for data in data_files(module))}
    return set(map(_short, files))


def _short(file: Path) -> str:
    return file.relative_to(SOURCES).as_posix() if file.is_relative_to(SOURCES) else str(file)


class Run(NamedTuple):
    """A job that has run, with the inputs of its rule and what it did."""

    words: list[str]
    inputs: set[str]
    traced: Traced


@pytest.fixture(scope="module")
def runs(bench: Bench) -> list[Run]:
    """Everything is made; then a job of each kind runs again, and is traced."""
    bench.made(*TARGETS)
    done = bench.snakemake("--detailed-summary", *TARGETS)
    rows = csv.DictReader(done.stdout.splitlines(), delimiter="\t")
    inputs = {row["shellcmd"]: row["input-file(s)"].split(",") for row in rows}
    chosen = dict[str, tuple[list[str], set[str]]]()
    for command, files in inputs.items():
        words = shlex.split(command)
        words = words[words.index("puckbench.jobs") + 1 : words.index(">")]
        key = words[1] if words[0] in ONCE else words[0]
        chosen.setdefault(key, (words, set(files)))
    commands = [words for words, _ in chosen.values()]
    traced = subprocess.run(
        [sys.executable, "-m", "tests.support.traced_jobs"],
        cwd=bench.folder,
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"},
        input=json.dumps(commands),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return [
        Run(*each, run)
        for each, run in zip(chosen.values(), json.loads(traced.stdout), strict=True)
    ]


@pytest.fixture(scope="module")
def code_of_records(jobs: dict[str, PlannedJob]) -> dict[str, set[str]]:
    """The files of the code of all jobs with the same settings, by the file of the settings."""
    planned: dict[str, set[str]] = {}
    for job in jobs.values():
        planned.setdefault(str(job.path), set()).update(code_of(job))
    return planned


KINDS = {
    *("scene", "sample", "scan", "prepare", "prepare_returns", "encode_curve", "decode"),
    *("decode_shown", "evaluate_curve", "evaluate", "recovery_curve", "train", "drive"),
    *("drive_of_clouds", "encode_drive", "measure_drive", "residuals", "wall_points"),
    *("capture_residuals", "calibrate", "joined_table", "compared_residuals", "rows_table"),
    *("plan_table", "table", "figure", "first_look", "reference"),
}


def test_a_job_of_each_kind_has_run(runs: list[Run]) -> None:
    assert [run.words for run in runs if run.traced["status"]] == []
    assert {run.words[0] for run in runs} == KINDS


def test_what_a_job_of_each_kind_runs_is_its_code(
    runs: list[Run], code_of_records: dict[str, set[str]]
) -> None:
    def uncovered(run: Run) -> set[str]:
        ours = {file for file in run.traced["ran"] if file.startswith(str(SOURCES))}
        ran = {_short(Path(file)) for file in ours} - OF_EVERY_JOB
        return {file for file in ran if not file.endswith("registry.py")} - code_of_records[
            run.words[1]
        ]

    assert {" ".join(run.words): left for run in runs if (left := uncovered(run))} == {}


def test_what_a_job_of_each_kind_opens_is_an_input_or_its_code(
    runs: list[Run], code_of_records: dict[str, set[str]], bench: Bench
) -> None:
    def uncovered(run: Run) -> set[str]:
        opened = {Path(file) for file in run.traced["opened"] if Path(file).is_file()}
        data = {_short(file) for file in opened if file.is_relative_to(SOURCES)}
        data = {file for file in data if not file.startswith(tuple(IN_PARAMETERS))}
        data -= {file for file in data if file.endswith(".py")}
        own = {word.partition("=")[2] or word for word in run.words[1:]} - run.inputs
        stems = {str(Path(file).with_suffix("")) for file in own}
        others = {
            file.relative_to(bench.folder) for file in opened if file.is_relative_to(bench.folder)
        }
        names = {str(file) for file in others if str(file.with_suffix("")) not in stems}
        return (data | names) - run.inputs - code_of_records[run.words[1]]

    assert {" ".join(run.words): left for run in runs if (left := uncovered(run))} == {}
