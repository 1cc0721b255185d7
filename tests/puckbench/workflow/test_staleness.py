"""A job runs again if and only if its inputs, parameters or code change: for every kind of job."""

from __future__ import annotations

import csv
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

from puckbench.planning.workflow import Workflow
from puckbench.steps.fingerprints import covered
from puckbench.steps.step import PlannedStep
from tests.support.bench import ROOT, Bench
from tests.support.every_job import CODEC, CONFIG, SOURCES, jobs_of
from tests.support.traced_jobs import Traced

TARGETS = [
    *("tables", "train", "results/residuals/calibrated.yaml", "results/reference.parquet"),
    *("results/decoded/sampled/chair_01/draco/r8.ply", "results/first_look/metrics.parquet"),
    "results/decoded/sampled/chair_01/draco.zip",
    *(f"results/figures/{name}.png" for name in ("fig_5_1", "fig_5_10", "fig_6_5", "truth_rd")),
]
ALL_TRACED = {"table", "evaluate", "encode", "study_table", "results_table"}
"""Jobs of which all are traced, not one of each kind."""
OF_EVERY_JOB = {
    *("puckbench/core/environment.py", "puckbench/core/introspection.py"),
    *("puckbench/core/packages.py", "puckbench/moved.py"),
    *("puckbench/steps/cost.py", "puckbench/steps/process.py", "puckbench/steps/step.py"),
}
"""Code that finds and starts jobs, or measures them: it changes no result."""
IN_PARAMETERS = {
    *("puckbench/codecs/styles.yaml", "puckbench/codecs/variants.yaml", "pcc_networks/weights"),
    "puckbench/report/assets",
    *("pointkit/lidar/sensors", "virtual_lidar/errors/calibrations"),
}
"""Data whose content, or whose digest, is among the parameters of the jobs that read them."""
NOT_OF_RESULTS = {
    *("jenco2022/claims/catalogue.yaml", "jenco2022/figures/model_styles.yaml"),
    *("virtual_lidar/errors/variants.yaml", "results/logs"),
}
"""Data that modules read as plug-ins are listed, and times, which reference results contain."""


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
def jobs(bench: Bench) -> dict[str, PlannedStep]:
    """The jobs of the configuration, by name."""
    with pytest.MonkeyPatch.context() as place:
        place.chdir(bench.folder)
        return jobs_of(Workflow(yaml.safe_load(Path("config.yaml").read_text())))


def code_of(job: PlannedStep) -> set[str]:
    """The files of a job's code, from the folder of the packages where they lie in it."""
    return set(map(_short, covered(type(job.step).__module__, *job.code)))


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
        words = words[words.index("puckbench.steps") + 1 : words.index(">")]
        key = words[-1] if words[0] in ALL_TRACED else words[0]
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


def _outputs(run: Run) -> set[str]:
    """The outputs of a job, without suffixes: some have another file beside them."""
    own = {word.partition("=")[2] or word for word in run.words[2:]} - run.inputs - {""}
    return {str(Path(file).with_suffix("")) + "." for file in own}


@pytest.fixture(scope="module")
def code_by_key(jobs: dict[str, PlannedStep]) -> dict[str, set[str]]:
    """The files of the code of all jobs, by the word of the command that identifies the job."""
    return {f"--key={job.key}": code_of(job) for job in jobs.values()}


KINDS = {
    *("scene", "sample", "scan", "prepare", "prepare_returns", "encode", "decode", "weights"),
    *("decode_shown", "evaluate", "scan_error", "recovery", "drive", "drive_of_clouds"),
    *("encode_drive", "measure_drive", "measure_undecoded", "residuals", "wall_points"),
    *("capture_residuals", "calibration", "study_table", "results_table", "table", "figure"),
    *("first_look", "reference", "segmentation_weights"),
}


def test_a_job_of_each_kind_has_run(runs: list[Run]) -> None:
    assert [run.words for run in runs if run.traced["status"]] == []
    assert {run.words[0] for run in runs} == KINDS


def test_what_a_job_of_each_kind_runs_is_its_code(
    runs: list[Run], code_by_key: dict[str, set[str]]
) -> None:
    def uncovered(run: Run) -> set[str]:
        ours = {file for file in run.traced["ran"] if file.startswith(str(SOURCES))}
        ran = {_short(Path(file)) for file in ours} - OF_EVERY_JOB
        return {
            file for file in ran if not file.endswith(("registry.py", "/__init__.py"))
        } - code_by_key[run.words[-1]]

    assert {" ".join(run.words): left for run in runs if (left := uncovered(run))} == {}


def test_what_a_job_of_each_kind_opens_is_an_input_or_its_code(
    runs: list[Run], code_by_key: dict[str, set[str]], bench: Bench
) -> None:
    def uncovered(run: Run) -> set[str]:
        opened = {Path(file) for file in run.traced["opened"] if Path(file).is_file()}
        ours = {_short(file) for file in opened if file.is_relative_to(SOURCES)}
        data = {file for file in ours if not file.endswith(".py")} | {
            str(file.relative_to(bench.folder))
            for file in opened
            if file.is_relative_to(bench.folder) and str(file) not in code_by_key[run.words[-1]]
        }
        others = tuple(IN_PARAMETERS | NOT_OF_RESULTS | _outputs(run))
        data = {file for file in data if not file.startswith(others)}
        return data - run.inputs - code_by_key[run.words[-1]]

    assert {" ".join(run.words): left for run in runs if (left := uncovered(run))} == {}


_CURVE = ("encode", "evaluate", "decode", "decode_shown")
CODECS = (*CONFIG["codecs"],)


def _curves(*codecs: str) -> set[str]:
    return {f"{kind} {codec}" for kind in _CURVE for codec in codecs}


def _each(kind: str, *names: str) -> set[str]:
    return {f"{kind} {name}" for name in names}


RECORDED = {"scene turns", "scene one_turn", "drive real", "capture_residuals box"}
DRIVES = {"encode_drive puck", "measure_drive puck"}
TRAININGS = {"train small", "segmentation small"}
SWEEPS = _each("figure", "sweeps_rd", "sweeps_truth", "sweeps_ranges")
"""Figures in one file with `spin_images`, which codes with `puck` itself."""
EVALUATED = {*_each("evaluate", *CODECS), "scan_error noisy", "scan_error spin", "train small"}
NETWORKS = ("pcgcv1_plus", "pcgcv2_plus", "sparse_octree_net")
OCTREE = (*NETWORKS, "gpcc", "gpcc_angular", "gpcc_predictive", "primitives")
STUDY = {"residuals vlp16", "wall_points vlp16"}
MINE = _curves("mine")
"""Curves of a codec in a user's file, for which all engines count."""
_CHAPTER_5 = (f"fig_5_{k}" for k in (*range(1, 9), *range(10, 19), 20, 21, 9))
THESIS = {
    *_each("figure", *_CHAPTER_5, "beside_thesis", "gpcc_grid", "model_verdict"),
    *_each("table", "claims", "gpcc_scales", "incidence_effect", "model_distances"),
    *_each("table", "residual_incidence", "residual_statistics", "table_4_1", "table_4_2"),
    *_each("table", "table_5_1", "thesis_medians", "thesis_numbers"),
}
"""Figures and tables of `jenco2022`, which count as one."""

CHANGED_BY: dict[str, set[str]] = {
    # Engines, of which the curves of all their codecs and of users' codecs are coded again.
    "puck/ranges.py": _curves("puck") | DRIVES | SWEEPS | MINE,
    "gpcc/octree.py": _curves(*OCTREE) | {"recovery primitives", "train small"} | MINE,
    "primitive_codec/region_merging.py": _curves("primitives") | {"recovery primitives"} | MINE,
    "pcc_networks/pcgcv1/inference.py": _curves("pcgcv1_plus") | MINE,
    "pcc_networks/pcgcv2/inference.py": _curves("pcgcv2_plus") | {"train small"} | MINE,
    "pcc_networks/octree_net/mixing.py": _curves("sparse_octree_net") | MINE,
    "pcc_networks/weights_file.py": _curves(*NETWORKS) | TRAININGS | MINE,
    "pcc_networks/training/loop.py": TRAININGS | MINE,
    # The network's folder counts as a whole.
    "pcc_networks/pcgcv2/training.py": _curves("pcgcv2_plus") | {"train small"} | MINE,
    "lidar_segmentation/training.py": {"segmentation small"} | MINE,
    "puckbench/codecs/storage/laz.py": _curves("laz"),
    "puckbench/codecs/storage/range_images.py": _curves("jpegxl"),
    "puckbench/codecs/storage/packets.py": _curves("packets_xz"),
    "puckbench/codecs/draco.py": _curves("draco"),
    "puckbench/codecs/learned.py": _curves(*NETWORKS) | {"train small"},
    "mine.py": MINE,
    # Scene sets and readers of files.
    "puckbench/scene_sets/mesh_files.py": {"scene meshes"},
    "puckbench/scene_sets/point_clouds.py": {"scene clouds"},
    "puckbench/scene_sets/recordings.py": RECORDED,
    "virtual_lidar/scenes/rooms.py": {"scene objects", "scene rooms"} | STUDY | MINE,
    "virtual_lidar/scenes/rooms.yaml": {"scene objects", "scene rooms"} | STUDY | MINE,
    "virtual_lidar/scenes/furniture/seating.py": {"scene objects", "scene rooms"} | STUDY | MINE,
    "cloud_files/las.py": RECORDED | _curves("laz") | MINE,
    "cloud_files/text.py": {*RECORDED, "scene clouds"} | MINE,
    "cloud_files/meshes/off.py": {"scene meshes"} | MINE,
    "cloud_files/meshes/obj.py": MINE,
    # The packets of puck's own recordings are code of its streams.
    "puck/recordings/packet_turns.py": RECORDED
    | _curves("packets_xz", "puck")
    | DRIVES
    | SWEEPS
    | MINE,
    # The sensor.
    "virtual_lidar/errors/vlp16.py": {
        *("scan noisy", "drive virtual", "table compared_residuals", "table table_5_1"),
        *STUDY,
        *MINE,
    },
    "virtual_lidar/errors/vlp16_divergence.py": {
        *("scan noisy", "table compared_residuals"),
        *MINE,
    },
    "virtual_lidar/raycast.py": {
        *("scan noisy", "scan spin", "drive virtual", "drive real"),
        *STUDY,
        *MINE,
    },
    "virtual_lidar/calibration/fitting.py": {
        *("calibration", "table compared_residuals", "table residuals", "table scans"),
        *MINE,
    },
    "virtual_lidar/walls/detection.py": {"capture_residuals box"} | MINE,
    # Metrics, tasks, tables and figures.
    "puckbench/metrics/geometry.py": EVALUATED,
    "puckbench/metrics/further_metrics/density.py": _each("evaluate", *CODECS),
    "puckbench/metrics/tasks/registration.py": {
        *("measure_drive puck", "measure_undecoded virtual", "measure_undecoded real"),
    },
    "puckbench/tables/nearest_truth.py": {"table nearest_truth", "table truth_bits"},
    "puckbench/figures/truth_rd.py": {
        f"figure truth_{name}" for name in ("rd", "rd_point", "rd_hausdorff", "accuracy")
    },
    "jenco2022/claims/rate_distortion.py": THESIS,
    "jenco2022/claims/catalogue.yaml": THESIS,
    "jenco2022/published.yaml": THESIS,
    "jenco2022/figures/residual_violins.py": THESIS,
    "puckbench/cli/prepare.py": set(),
    "puckbench/cli/scan.py": set(),
}
"""Files of code and data, and the jobs that run again if one is edited, by kind and by what they
code, make or read."""


def _named(job: str) -> str:
    """A job's kind, and its codec, if any, or what it makes."""
    kind, _, what = job.partition(" ")
    return f"{kind} {what.rpartition('/')[2]}".rstrip()


def test_an_edit_of_pointkit_changes_the_code_of_all_jobs(jobs: dict[str, PlannedStep]) -> None:
    assert all("pointkit/geometry/morton.py" in code_of(job) for job in jobs.values())


@pytest.mark.parametrize("room", ["puckbench/figures/style.py", "puckbench/results/columns.py"])
def test_an_edit_of_a_room_changes_no_code_before_tables_and_figures(
    jobs: dict[str, PlannedStep], room: str
) -> None:
    changed = {name.partition(" ")[0] for name, job in jobs.items() if room in code_of(job)}
    assert "table" in changed
    assert changed <= {"table", "figure", "first_look", "report", "reference"}


@pytest.mark.parametrize("file", CHANGED_BY)
def test_an_edit_of_a_file_changes_the_code_of_these_jobs_alone(
    jobs: dict[str, PlannedStep], file: str, bench: Bench
) -> None:
    place = str(bench.folder / file) if (bench.folder / file).exists() else file
    changed = {_named(name) for name, job in jobs.items() if place in code_of(job)}
    assert changed == CHANGED_BY[file]


REAL_EDITS: list[tuple[str, str, str, set[str]]] = [
    (
        "puck/least_squares.py",
        "_RIDGE = 5000",
        "_RIDGE = 6000",
        _curves("puck") | DRIVES | SWEEPS | MINE,
    ),
    ("mine.py", "import numpy", "# A comment.\nimport numpy", set()),
    ("path.csv", "0.3,0.2", "0.3,0.1", {"drive virtual"}),
    (
        "virtual_lidar/errors/calibrations/vlp16_measured.yaml",
        "  ray_sigma_m: 0.0065",
        "  ray_sigma_m: 0.0066",
        {"table compared_residuals"},
    ),
]
"""Edits of files (old text, new text), and the jobs that have other settings or fingerprints."""


def test_edits_of_the_tree_change_the_plans_of_these_jobs_alone(
    bench: Bench, tmp_path: Path
) -> None:
    """As new processes see them, whose sources are a copy."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "src", tmp_path / "src", ignore=ignored)
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.every_job", "config.yaml"],
        cwd=bench.folder,
        env={**os.environ, "PYTHONPATH": f"{tmp_path / 'src'}{os.pathsep}{ROOT}"},
        input=json.dumps([edit[:3] for edit in REAL_EDITS]),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    for (file, *_, expected), names in zip(REAL_EDITS, json.loads(done.stdout), strict=True):
        words = (name.split(" ") for name in names)
        changed = {
            f"{kind} {what[0].rpartition('/')[2]}" if what else kind for kind, *what in words
        }
        assert changed == expected, file
