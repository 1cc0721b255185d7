"""The whole graph on tiny data, partial regeneration, killed runs and bad input.

All tests of the finished folder stand here, since each process of a test run makes its own.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from puckbench.codecs.registry import open_codec
from puckbench.figures.registry import figure_entries
from puckbench.planning.workflow import Workflow
from puckbench.results.curves import read_curve
from puckbench.tables.registry import SENSOR, table_entries
from tests.support.bench import BOX_CODEC, RAW_CODEC, ROOT, Bench
from tests.support.same_results import after_a_kill, differences


@pytest.fixture
def restored(finished: Bench) -> Iterator[Bench]:
    """The finished folder, its configuration and codec put back afterwards."""
    yield finished
    finished.configure({})
    (finished.folder / "raw_grid.py").write_text(RAW_CODEC)
    (finished.folder / "box.py").write_text(BOX_CODEC)


_OTHERS = {entry.instead_of for entry in figure_entries().values()}
"""Figures that are drawn under another name."""
SCALED = {
    name
    for name, entry in figure_entries().items()
    if entry.frame == "scaled" and name not in _OTHERS
}
# Those that need a capture, G-PCC, drives, or labels.
ABSENT = {
    *("model_verdict", "gpcc_grid", "gpcc_rounding", "gpcc_contexts"),
    *("odometry", "perception"),
}


def test_one_command_makes_every_table_and_figure(finished: Bench) -> None:
    table = pd.read_csv(finished.results / "tables" / "metrics.csv")
    assert len(table) == 4 * 5  # data sets x (two rates of draco, one of raw_grid, two of box)
    assert table.bpp.gt(0).all()
    assert table.cd_plane.notna().all()
    assert table.truth_cd_plane.notna().all()
    figures = {path.stem for path in (finished.results / "figures").glob("*.pdf")}
    assert figures == SCALED - ABSENT
    assert all(path.stat().st_size > 1000 for path in (finished.results / "figures").iterdir())


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("decoded/objects/chair_01/draco/r99.ply", "codec draco has no rate 'r99'"),
        ("metrics/noisy/chair_01/draco.parquet", "data set noisy has no cloud 'chair_01'"),
        ("scenes/rooms/nowhere.ply", "rooms has no scene 'nowhere'"),
    ],
)
def test_a_target_that_the_plan_lacks_is_one_line(fresh: Bench, target: str, said: str) -> None:
    done = fresh.snakemake(f"results/{target}")
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if "puckbench: " in line]
    assert line.startswith(f"puckbench: {said}")
    assert "Error" not in done.stderr


def test_bits_count_every_byte_of_the_stream_over_the_input_points(finished: Bench) -> None:
    table = pd.read_parquet(finished.results / "tables" / "metrics.parquet")
    for row in table.itertuples():
        curve = read_curve(
            finished.results / "coded" / row.dataset / row.cloud / f"{row.codec}.zip"
        )
        assert row.bytes == len(curve[row.rate].stream)
        assert row.bpp == 8 * row.bytes / row.points_in


def test_noise_separates_the_scan_from_the_truth(finished: Bench) -> None:
    table = pd.read_csv(finished.results / "tables" / "metrics.csv")
    best = table[(table.codec == "draco") & (table.rate == "r8")].set_index("dataset")
    assert best.truth_cd_plane["clean"] < 0.1
    assert best.truth_cd_plane["noisy"] > 10 * best.cd_plane["noisy"]


def test_scans_are_measured_against_the_clean_scan_of_the_same_rays(finished: Bench) -> None:
    table = pd.read_csv(finished.results / "tables" / "metrics.csv").set_index("dataset")
    assert table.clean_cd_plane[["clean", "noisy"]].notna().all()
    assert table.clean_cd_plane[["objects", "raw"]].isna().all()
    for kind in ("point", "plane"):
        to_rays, to_truth = table[f"clean_acd_ab_{kind}"], table[f"truth_acd_ab_{kind}"]
        assert to_rays.dropna().equals(to_truth[to_rays.notna()])


def test_a_scans_own_error_is_what_a_codec_with_enough_bits_ends_at(finished: Bench) -> None:
    own = pd.read_csv(finished.results / "tables" / "scan_errors.csv").set_index("dataset")
    assert list(own.index) == ["clean", "noisy"]
    assert own.truth_cd_plane["clean"] < 1e-9
    table = pd.read_csv(finished.results / "tables" / "metrics.csv")
    best = table[(table.codec == "draco") & (table.rate == "r8")].set_index("dataset")
    for column in ("truth_cd_plane", "clean_cd_plane", "truth_d2_rms_m"):
        assert best[column]["noisy"] == pytest.approx(own[column]["noisy"], rel=0.1)


def test_primitives_are_held_against_the_labels_of_the_scene(finished: Bench) -> None:
    table = pd.read_csv(finished.results / "tables" / "recovery.csv")
    assert set(table.codec) == {"box"}
    assert set(table.dataset) == {"raw", "clean", "noisy"}
    rows = table[(table.dataset == "raw") & (table.kind == "plane")].set_index("rate")
    assert list(rows.index) == ["r1"]
    (row,) = rows.itertuples()
    assert row.found == 6
    assert row.matched == 1  # the ceiling: before the other sides of the box there is furniture
    assert row.precision == pytest.approx(1 / 6)
    assert row.position_m < 0.01
    streams_of_points = table[table.rate == "r2"]
    assert len(streams_of_points) == 3
    assert streams_of_points[["found", "recall"]].isna().all(axis=None)


def test_the_sensor_study_makes_its_tables(finished: Bench) -> None:
    tables = finished.results / "tables"
    made = {path.stem for path in tables.glob("*.csv")}
    study = {name for name, entry in table_entries().items() if entry.category == SENSOR}
    assert study - made == {"model_distances"}  # which needs a capture
    residuals = pd.read_parquet(tables / "residuals.parquet")
    counts = residuals.groupby(["model", "distance_m"], observed=True).size()
    assert counts.to_dict() == {
        (model, distance): 300 for model in ("vlp16", "vlp16_divergence") for distance in (1, 5, 30)
    }
    statistics = pd.read_csv(tables / "residual_statistics.csv")
    whole = statistics[(statistics[["surface", "distance_m", "laser_id"]] == "all").all(axis=1)]
    assert whole["std_m"].between(0.012, 0.017).all()


def test_the_claims_are_tested_on_the_tables_of_the_run(finished: Bench) -> None:
    table = pd.read_csv(finished.results / "tables" / "claims.csv").fillna("")
    verdicts = table.set_index("number")["verdict"]
    assert len(verdicts) == 14
    assert not verdicts[3].startswith("not tested")  # both models are there, one scan each
    assert verdicts[4] == "not tested: needs the sensor study (sensor_study) with the error " + (
        "model vlp16_incidence, from 1 or 5 m"
    )
    assert verdicts[6].startswith("not tested: needs 4 rates and 4 clouds or more of Draco")
    assert verdicts[7].startswith("not tested: needs the codec pcgcv1")
    medians = pd.read_csv(finished.results / "tables" / "thesis_medians.csv")
    assert set(medians["kind"]) == {"objects", "rooms", "clean scans", "noisy scans"}
    assert set(medians["rate"]) == {"r1", "r8"}


def test_nothing_is_left_to_do_afterwards(finished: Bench) -> None:
    assert finished.planned() == {}


def test_reference_results_are_made_of_the_tables_that_are_there(finished: Bench) -> None:
    assert finished.planned("reference") == {"reference": 1}


def test_a_figures_style_draws_that_figure_alone(restored: Bench) -> None:
    restored.configure({"figures.options": {"fig_6_6": {"font_size": 9}}})
    assert restored.planned() == {"fig_6_6": 1, "report_page": 1}


def test_a_style_of_chapter_5_draws_that_figure_alone(restored: Bench) -> None:
    restored.configure({"figures.options": {"fig_5_18": {"font_size": 9}}})
    assert restored.planned() == {"fig_5_18": 1, "report_page": 1}


def test_one_error_model_is_measured_again_alone(restored: Bench) -> None:
    model = {"error_options": {"ray_sigma_m": 0.011}}
    restored.configure({"sensor_study.models.vlp16": model})
    jobs = restored.planned()
    assert (jobs.pop("residuals"), jobs.pop("wall_points")) == (1, 1)
    tables = {"residuals_table", "scans_table", "incidence_effect", "residual_incidence"}
    assert tables | {"residual_statistics", "thesis_numbers"} <= set(jobs)
    drawn = {job for job in jobs if job.startswith("fig_")}
    assert drawn == {f"fig_5_{number}" for number in range(2, 21)}
    assert not {"table_5_1", "scan", "encode_draco", "metrics_table"} & set(jobs)


def test_captures_stand_beside_the_models_and_judge_them(restored: Bench) -> None:
    capture = restored.capture()
    # Results of their own, so that those of the other tests stay as they are.
    restored.configure({"results": "judged", "sensor_study.captures": {"box": {"path": capture}}})
    calibrated = "judged/residuals/calibrated.yaml"
    restored.made(
        "judged/figures/model_verdict.png", "judged/tables/thesis_numbers.csv", calibrated
    )
    model = yaml.safe_load((restored.folder / calibrated).read_text())
    assert model["provenance"]["counts"]["devices"] == 1
    tables = restored.folder / "judged" / "tables"
    residuals = pd.read_parquet(tables / "residuals.parquet")
    real = residuals[residuals["model"] == "real"]
    assert len(real) > 10_000
    assert set(real["surface"]) == {"wall"}
    distances = pd.read_csv(tables / "model_distances.csv").set_index("model")
    assert distances["emd_m"].drop("real").idxmax() == "hdl64e"
    # What was captured is a scan with the sigmas of vlp16, its biases drawn once.
    assert real["residual_m"].std() == pytest.approx(distances.loc["real", "std_m"], rel=0.05)


def test_one_codecs_code_re_runs_its_curves_alone(restored: Bench) -> None:
    (restored.folder / "raw_grid.py").write_text(RAW_CODEC.replace('"raw 1"', '"raw 2"'))
    jobs = restored.planned()
    curves = {f"{stage}_raw_grid" for stage in ("encode", "evaluate", "decode_shown")}
    assert {jobs.pop(name) for name in curves} == {4}  # one job for each cloud
    truth = {"truth_rd", "truth_rd_point", "truth_rd_hausdorff", "truth_accuracy"}
    drawn = {*(f"fig_6_{n}" for n in range(5, 10)), *truth, "spread", "beside_thesis", "elongation"}
    drawn.add("report_page")
    tables = {"bd_rate", "bd_rate_clouds", "bd_rate_pairs", "uses"}
    tables |= {"claims", "lossless_bits", "machines", "rates", "summary"}
    tables |= {"nearest_truth", "truth_bits", "thesis_medians"}
    first = {"first_look"} & set(jobs)  # of the first codec alone
    assert set(jobs) == {"metrics_table", *tables, *drawn, *first}


def test_a_codec_of_surfaces_is_held_against_the_labels_again(restored: Bench) -> None:
    (restored.folder / "box.py").write_text(BOX_CODEC.replace('"box 1"', '"box 2"'))
    jobs = restored.planned()
    assert jobs["encode_box"] == jobs["evaluate_box"] == 4
    assert jobs["recovery_box"] == 3  # rooms
    assert not {"encode_draco", "evaluate_draco"} & set(jobs)
    assert jobs["recovery_table"] == jobs["recovery_rd"] == 1
    assert not {"scan", "prepare", "scan_error", "scan_errors_table"} & set(jobs)


def test_a_comment_in_a_codec_re_runs_nothing(restored: Bench) -> None:
    (restored.folder / "raw_grid.py").write_text("# A comment.\n" + RAW_CODEC)
    assert restored.planned() == {}


def test_a_rate_re_runs_its_codecs_curves_alone(restored: Bench) -> None:
    restored.configure({"codecs.raw_grid.rates": {"r1": {"step": 1.5}}})
    jobs = restored.planned()
    again = {name for name in jobs if name.startswith(("encode", "evaluate", "decode"))}
    assert again == {"encode_raw_grid", "evaluate_raw_grid", "decode_shown_raw_grid"}
    assert (jobs["encode_raw_grid"], jobs["evaluate_raw_grid"]) == (4, 4)


def test_a_data_sets_seed_re_makes_what_depends_on_it(restored: Bench) -> None:
    restored.configure({"datasets.noisy.seed": 5})
    jobs = restored.planned()
    once = {"scan", "prepare", "scan_error", "fig_6_3", "fig_6_4"}
    stages, codecs = ("encode", "evaluate", "decode_shown"), ("draco", "raw_grid", "box")
    once |= {f"{stage}_{codec}" for stage in stages for codec in codecs} | {"recovery_box"}
    assert {jobs[name] for name in once} == {1}
    assert not {"scene", "sample", "fig_6_1", "fig_6_2"} & set(jobs)


def test_single_targets_by_path(fresh: Bench) -> None:
    rows = "results/metrics/objects/chair_01/draco.parquet"
    assert fresh.planned(rows) == {
        "scene": 1,
        "sample": 1,
        "prepare": 1,
        "encode_draco": 1,
        "evaluate_draco": 1,
    }
    shown = fresh.planned("results/decoded/objects/chair_01/draco.zip")
    assert shown["decode_shown_draco"] == shown["encode_draco"] == 1
    assert not {"evaluate_draco", "scan", "encode_box"} & set(shown)
    assert "fig_6_6" not in fresh.planned("tables")
    assert fresh.planned("results/figures/fig_6_1.pdf") == {
        "scene": 1,
        "sample": 1,
        "prepare": 1,
        "fig_6_1": 1,
    }


def test_a_rate_is_decoded_alone(fresh: Bench) -> None:
    target = "results/decoded/objects/chair_01/draco/r1.ply"
    planned = fresh.planned(target)
    assert planned["decode_draco_r1"] == planned["encode_draco"] == 1
    assert "evaluate_draco" not in planned
    fresh.made(target)
    curve = read_curve(fresh.results / "coded" / "objects" / "chair_01" / "draco.zip")
    decoded = open_codec("draco").decode(curve["r1"].stream).xyz
    assert np.allclose(read_cloud(fresh.folder / target).xyz, decoded)


def test_the_page_holds_results_figures_and_decoded_examples(finished: Bench) -> None:
    text = (finished.results / "report.html").read_text(encoding="utf-8")
    parts = re.findall(r'<script type="application/json" id="data-(\w+)">(.*?)</script>', text)
    data = {name: json.loads(part) for name, part in parts}
    assert len(data["curves"]["cells"]) == 4 * 5
    decoded = [len(example["decoded"]) for example in data["clouds"]["examples"]]
    assert decoded == [5, 5, 5, 5]  # two rates of draco, one of raw_grid, two of box
    assert text.count('id="figure-') == len(SCALED - ABSENT)
    for table in ("summary", "bd_rate", "thesis_numbers", "table_4_1"):
        assert f'id="table-{table}"' in text


def test_snakemakes_own_report_is_one_file(finished: Bench) -> None:
    command = finished.command("--report", "report.html")
    at = command.index("--cores")  # which no command needs that runs nothing
    subprocess.run(command[:at] + command[at + 2 :], cwd=finished.folder, check=True)
    report = (finished.folder / "report.html").read_text(encoding="utf-8")
    for text in ("Medians per compression rate", "fig_6_5", "metrics.csv", "Tables", "fig_5_18"):
        assert text in report


def test_the_linter_is_content(fresh: Bench) -> None:
    done = fresh.snakemake("--lint")
    assert done.returncode == 0, done.stderr
    assert "good condition" in done.stdout + done.stderr


def test_a_killed_run_on_one_core_goes_on_and_ends_with_the_same_results(
    fresh: Bench, finished: Bench
) -> None:
    """benchmarks/checks/killed_runs.py does so at many points; the finished run had two cores."""
    tables = [f"results/tables/{name}.csv" for name in ("metrics", "bd_rate", "scan_errors")]
    process = subprocess.Popen(
        fresh.command(*tables, "--cores", "1"),
        cwd=fresh.folder,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    _wait_until(lambda: any((fresh.results / "coded").rglob("*.zip")), process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert after_a_kill(fresh.results, finished.results) == []
    assert not (fresh.folder / tables[0]).exists()
    fresh.made(*tables, "--cores", "1")
    assert all((fresh.folder / table).exists() for table in tables)
    assert differences(fresh.results, finished.results, finished=False) == []


def test_rules_are_named_on_the_command_line_as_in_any_workflow(fresh: Bench) -> None:
    def jobs(*words: str) -> dict[str, int]:
        done = fresh.snakemake("--dry-run", *words)
        assert done.returncode == 0, done.stderr[-4000:]
        counts = re.findall(r"^(\w+) +(\d+)$", done.stdout + done.stderr, re.MULTILINE)
        return {rule: int(count) for rule, count in counts}

    assert set(jobs("--until", "encode")) == {
        *("scene", "sample", "scan", "prepare", "encode", "total"),
    }
    assert not {"encode", "evaluate", "recovery"} & set(jobs("--omit-from", "encode"))
    target = "results/coded/objects/chair_01/draco.zip"
    asked = ["--set-resources", "encode:mem_mb=123", "--set-threads", "encode=2", "--quiet", "host"]
    done = fresh.snakemake(target, *asked, "--dry-run", "--printshellcmds")
    text = done.stdout + done.stderr
    assert done.returncode == 0
    assert "mem_mb=123" in text
    assert "threads: 2" in text
    (command,) = re.findall(r"python -m puckbench.steps encode .*", text)
    assert '"codec":"draco"' in command


def test_a_store_carries_the_files_between_jobs(fresh: Bench, tmp_path: Path) -> None:
    small = {"sensor_study": None, "codecs": {"draco": {"rates": ["r1", "r8"]}}}
    fresh.configure({**small, "figures.examples": {"object": "objects/chair_01"}})
    store = tmp_path / "store"
    store.mkdir()
    provider = ["--default-storage-provider", "fs", "--default-storage-prefix", str(store)]
    fresh.made(*provider)
    assert not any(fresh.results.rglob("*.parquet"))
    table = pd.read_parquet(store / "results" / "tables" / "metrics.parquet")
    assert len(table) == 4 * 2
    page = (store / "results" / "report.html").read_text(encoding="utf-8")
    assert 'id="figure-fig_6_5"' in page
    again = fresh.snakemake("--dry-run", *provider)
    assert "Nothing to be done" in again.stdout + again.stderr


def test_results_copied_beside_a_fresh_clone_are_up_to_date(
    finished: Bench, tmp_path: Path
) -> None:
    assert finished.copied(tmp_path / "copy").planned() == {}


def _wait_until(happened: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    while not happened():
        assert process.poll() is None, "the run has ended before"
        time.sleep(0.05)


def test_two_runs_at_once_are_kept_apart(fresh: Bench) -> None:
    process = subprocess.Popen(
        fresh.command(), cwd=fresh.folder, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        _wait_until((fresh.results / ".lock").exists, process)
        done = fresh.snakemake()
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert done.returncode == 2
    assert (
        done.stderr.splitlines()[-1] == "puckbench: results: another run is writing to this folder"
    )


def test_a_failed_run_says_at_its_end_what_failed(fresh: Bench) -> None:
    failing = RAW_CODEC.replace("return np.round", "raise InputError('no pens')  #")
    imports = "from pointkit.errors import InputError\n"
    (fresh.folder / "raw_grid.py").write_text(imports + failing)
    row = "results/metrics/objects/chair_01/raw_grid.parquet"
    done = fresh.snakemake(row, "--quiet", "rules", "host", "reason")
    assert done.returncode == 1
    log = "results/logs/coded/objects/chair_01/raw_grid.log"
    job = "codec raw_grid, cloud objects/chair_01"
    assert f"puckbench: {job}: rate r1: no pens; log: {log}" in done.stderr.splitlines()


def test_results_that_cannot_be_written_end_in_one_line(fresh: Bench) -> None:
    fresh.configure({"results": "/sys/results"})  # where nobody makes folders, root neither
    done = fresh.snakemake()
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("puckbench: /sys/results: ")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"codecs": {"drako": {}}}, "unknown codec 'drako' (known: draco"),
        ({"codecs.draco.rates": ["r12"]}, "codec draco: unknown rate 'r12'"),
        ({"datasets.raw.scene_set": "roms"}, "datasets.raw.scene_set: no scene set 'roms'"),
        ({"scene_sets.rooms.loader": "romms"}, "scene_sets.rooms: unknown loader 'romms'"),
        (
            {"scene_sets.rooms.options": {"detial": 1}},
            "scene_sets.rooms: loader embedded_rooms: unknown",
        ),
        ({"scene_sets.rooms.select": ["cellar"]}, "scene_sets.rooms.select: no scene 'cellar'"),
        ({"datasets.noisy.errors": "vlp61"}, "datasets.noisy: unknown error model 'vlp61'"),
        ({"datasets.noisy.sensor": "vlp61"}, "datasets.noisy: unknown sensor 'vlp61'"),
        ({"datasets.noisy.sweep": {"fsp": 3}}, "datasets.noisy: sweep"),
        ({"figures.style": {"fontsize": 3}}, "figures.style: figure style: unknown option"),
        ({"figures.examples": {"raw": "raw/x"}}, "figures.examples: no cloud 'raw/x'"),
        ({"sensor_study.models": {"vlp61": {}}}, "sensor_study.models.vlp61: unknown error model"),
        ({"datsets": {}}, "the configuration: unknown key 'datsets'"),
        (
            {"scene_sets.objects": {"loader": "mesh_files", "options": {"path": "nowhere"}}},
            "scene_sets.objects: nowhere: no such file",
        ),
    ],
)
def test_bad_configurations_are_refused_in_one_line(
    fresh: Bench, monkeypatch: pytest.MonkeyPatch, changes: dict[str, object], message: str
) -> None:
    fresh.configure(changes)
    monkeypatch.chdir(fresh.folder)
    config = yaml.safe_load(Path("config.yaml").read_text())
    with pytest.raises(InputError, match=re.escape(message)) as error:
        Workflow(config, True)  # as the workflow does, which prints the error
    assert len(str(error.value).splitlines()) == 1
    assert not fresh.results.exists()


def test_a_bad_configuration_ends_in_one_line_and_status_2(fresh: Bench) -> None:
    fresh.configure({"codecs": {"drako": {}}})
    done = fresh.snakemake("--quiet")
    lines = [line for line in done.stderr.splitlines() if line.startswith("puckbench: ")]
    assert done.returncode == 2
    assert len(lines) == 1
    assert "unknown codec 'drako' (known: draco" in lines[0]
    assert "Traceback" not in done.stderr
    assert not fresh.results.exists()


def test_an_unreadable_mesh_stops_what_needs_it_and_no_more(fresh: Bench) -> None:
    meshes = fresh.folder / "meshes"
    meshes.mkdir()
    (meshes / "bad.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n")
    (meshes / "good.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    fresh.configure(
        {
            "scene_sets.objects": {"loader": "mesh_files", "options": {"path": "meshes"}},
            "figures.examples": {},
        }
    )
    rows = [f"results/metrics/objects/{name}/draco.parquet" for name in ("bad", "good")]
    done = fresh.snakemake(*rows)
    assert done.returncode == 1
    assert "bad.off" in done.stderr
    assert (fresh.folder / rows[1]).exists()
    assert not (fresh.results / "scenes" / "objects" / "bad.ply").exists()


TABLE = '''"""One more table."""

from puckbench.tables.registry import TABLES


@TABLES.register("streams", title="Streams")
def streams(metrics: "pd.DataFrame") -> "pd.DataFrame":
    """How many streams each codec made."""
    return metrics.groupby("codec").size().rename("streams").reset_index()
'''


@pytest.fixture
def copied(finished: Bench, tmp_path: Path) -> Iterator[Bench]:
    """The finished folder, with a workflow and sources of its own to edit."""
    for name in ("src", "workflow"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    before = finished.snakefile
    finished.snakefile = tmp_path / "workflow" / "Snakefile"
    yield finished
    finished.snakefile = before


def edit(bench: Bench, module: str, old: str, new: str) -> None:
    path = bench.snakefile.parents[1] / "src" / "puckbench" / module
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_a_copy_of_the_sources_and_other_help_texts_re_make_nothing(copied: Bench) -> None:
    assert copied.planned() == {}
    edit(copied, "cli/registry.py", "code a cloud with a codec at a rate", "encode a cloud")
    edit(copied, "cli/scan.py", "metres", "in metres")
    edit(copied, "codecs/draco.py", '"""', '"""In other words: ')
    assert copied.planned() == {}


def test_a_new_registration_makes_what_it_registers(copied: Bench) -> None:
    tables = copied.snakefile.parents[1] / "src" / "puckbench" / "tables"
    (tables / "streams.py").write_text(TABLE)
    assert copied.planned() == {"streams": 1, "report_page": 1}


def test_an_edited_codec_makes_its_own_curves_again(copied: Bench) -> None:
    edit(copied, "codecs/draco.py", "\n\n\n", "\n\n\nEDITED = 1\n\n\n")
    jobs = copied.planned()
    assert (jobs["encode_draco"], jobs["evaluate_draco"]) == (4, 4)  # clouds
    assert not {"encode_box", "evaluate_box", "recovery_box"} & set(jobs)
    assert jobs["metrics_table"] == 1
    first = {"scene", "sample", "scan", "prepare", "scan_error", "residuals", "wall_points"}
    assert not first & set(jobs)
    assert not {job for job in jobs if job.startswith("fig_5_")}


@pytest.mark.parametrize(
    ("lost", "jobs"),
    [
        ("coded/objects/chair_01/draco.zip", {"encode_draco": 1, "evaluate_draco": 1}),
        ("metrics/objects/chair_01/draco.parquet", {"evaluate_draco": 1}),
    ],
)
def test_a_lost_curve_is_made_again(finished: Bench, lost: str, jobs: dict[str, int]) -> None:
    path = finished.results / lost
    aside = path.rename(path.with_suffix(".aside"))
    try:
        planned = finished.planned()
    finally:
        aside.rename(path)
    assert jobs.items() <= planned.items()
    assert "metrics_table" in planned
    assert not {"encode_box", "evaluate_box", "prepare"} & set(planned)
