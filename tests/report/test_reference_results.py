"""Reference results: kept whole in one file, made again by a fresh run, and shown as pages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from puckbench.core.errors import InputError
from puckbench.io.tables import write_table
from puckbench.jobs.registry import JOBS
from puckbench.planning.workflow import Workflow
from puckbench.report.leaderboard import study_findings, write_study
from puckbench.report.reference_results import (
    DIGEST,
    FOLDER,
    ReferenceResults,
    read_reference,
    shipped,
    write_reference,
)
from tests.support import reference_lookalike
from tests.support.in_process import run_in_process

CONFIG: dict[str, Any] = {
    "seed": 3,
    "scenes": {"objects": {"loader": "embedded_objects", "select": ["lamp_01", "chair_01"]}},
    "datasets": {
        "objects": {"scenes": "objects", "make": "sample", "points": 1500, "truth": False}
    },
    "codecs": {"draco": {"rates": ["r3", "r6"]}},
    "timing": {"repeats": 1},
}
SAMPLED = "draco"
"""A fast codec that every study has."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> ReferenceResults:
    """A small study, kept as `make reference` keeps it."""
    folder = tmp_path_factory.mktemp("made")
    config = {**CONFIG, "results": str(folder / "results")}
    metrics, clouds = run_in_process(config)
    files = {"metrics": folder / "metrics.parquet", "clouds": folder / "clouds.parquet"}
    write_table(metrics, files["metrics"])
    write_table(clouds, files["clouds"])
    job = Workflow(config).outputs.reference
    done = JOBS.get(job.name).given(**json.loads(job.record))
    done.run(**files, out=folder / "small.parquet")
    return read_reference(str(folder / "small.parquet"))


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> ReferenceResults:
    """A study of two codecs whose numbers are known."""
    folder = tmp_path_factory.mktemp("study")
    return read_reference(str(reference_lookalike.write_study(folder / "known.parquet")))


def sample_of(reference: ReferenceResults) -> tuple[str, str]:
    """The smallest scaled cloud of a study."""
    rows = reference.metrics[reference.metrics["codec"] == SAMPLED]
    if "frame" in rows:
        rows = rows[rows["frame"] != "metric"]
    dataset, cloud = rows.loc[rows["points_in"].idxmin(), ["dataset", "cloud"]]
    return str(dataset), str(cloud)


def only(configuration: Any, dataset: str, cloud: str) -> dict[str, Any]:
    """The configuration of one cloud and codec of a study."""
    chosen = configuration["datasets"][dataset]
    scenes = configuration["scenes"][chosen["scenes"]]
    return {
        "seed": configuration["seed"],
        "scenes": {chosen["scenes"]: {**scenes, "select": [cloud]}},
        "datasets": {dataset: {**chosen, "codecs": None}},
        "codecs": {SAMPLED: configuration["codecs"][SAMPLED]},
        "timing": configuration["timing"],
    }


def check_a_sample(reference: ReferenceResults, folder: Path) -> None:
    """Compare digest, bytes and metrics of one cloud with those of a fresh run."""
    dataset, cloud = sample_of(reference)
    config = only(reference.about["configuration"], dataset, cloud)
    metrics, clouds = run_in_process({**config, "results": str(folder / "results")})
    rows = reference.metrics
    rows = rows[
        (rows["dataset"] == dataset) & (rows["cloud"] == cloud) & (rows["codec"] == SAMPLED)
    ]
    rows, fresh = rows.set_index("rate"), metrics.set_index("rate")
    assert list(fresh.index) == list(rows.index)
    assert set(rows[DIGEST]) == set(clouds["digest"])
    assert fresh["bytes"].tolist() == rows["bytes"].tolist()
    told = rows.columns[rows.notna().all()]
    compared = {"d1_psnr", "d2_psnr", "cd_plane", "truth_cd_plane"} & set(told)
    assert compared
    for name in sorted(compared):
        np.testing.assert_allclose(fresh[name], rows[name], rtol=2e-5, err_msg=name)


def test_a_fresh_run_of_one_cloud_gives_the_same_row(
    made: ReferenceResults, tmp_path: Path
) -> None:
    assert sample_of(made)[1] in {"lamp_01", "chair_01"}
    check_a_sample(made, tmp_path)


@pytest.mark.parametrize("name", shipped())
def test_the_results_that_come_with_puckbench_are_made_again(name: str, tmp_path: Path) -> None:
    reference = read_reference(name)
    try:
        Workflow(only(reference.about["configuration"], *sample_of(reference)))
    except InputError:
        pytest.skip("the data of this study are not here")
    check_a_sample(reference, tmp_path)


@pytest.mark.parametrize("name", shipped())
def test_what_comes_with_puckbench_is_small_and_of_committed_sources(name: str) -> None:
    reference = read_reference(name)
    commits = reference.record.commits
    assert commits
    assert not any(commit.endswith("-dirty") for commit in commits)
    assert reference.about["machine"]["Processor"]
    assert (FOLDER / f"{name}.parquet").stat().st_size < 2_000_000


def test_another_seed_is_noticed(made: ReferenceResults, tmp_path: Path) -> None:
    about = {**made.about, "configuration": {**made.about["configuration"], "seed": 4}}
    with pytest.raises(AssertionError):
        check_a_sample(ReferenceResults("other", made.metrics, about), tmp_path)


def test_numbers_are_kept_to_six_digits(tmp_path: Path) -> None:
    rows = reference_lookalike.rows_of("draco", 1 / 3)
    about = {
        "clouds": reference_lookalike.clouds_of(reference_lookalike.CLOUDS).to_dict("records"),
        "style": [],
    }
    write_reference(tmp_path / "some.parquet", rows.assign(d1_psnr=100 / 3), about)
    found = read_reference(str(tmp_path / "some.parquet"))
    np.testing.assert_allclose(found.metrics["d1_psnr"], 100 / 3, rtol=1e-6)
    np.testing.assert_allclose(found.metrics["bpp"], rows["bpp"], rtol=1e-5)
    assert found.metrics["bytes"].tolist() == rows["bytes"].tolist()
    assert found.metrics[DIGEST].nunique() == 4


def test_a_cloud_without_a_digest_is_refused(tmp_path: Path) -> None:
    about = {"clouds": [{"dataset": "objects", "cloud": "thing_0"}]}
    with pytest.raises(InputError, match="objects/thing_0: the table of clouds has no digest"):
        write_reference(tmp_path / "a.parquet", reference_lookalike.rows_of("draco", 1), about)


def test_a_newer_format_is_refused(study: ReferenceResults, tmp_path: Path) -> None:
    about = {**study.about, "format": 99}
    write_reference(tmp_path / "a.parquet", study.metrics.drop(columns=DIGEST), about)
    with pytest.raises(InputError, match="format 99, but this version reads 1"):
        read_reference(str(tmp_path / "a.parquet"))


def test_the_findings_say_who_needs_the_fewest_bits(study: ReferenceResults) -> None:
    found = study_findings(study)
    assert found.anchor == "G-PCC"
    (things,) = found.datasets
    assert (things.title, things.clouds) == ("Things", 4)
    column = things.columns[0]
    assert column.best == ("gpcc",)
    assert column.cells["draco"].text.startswith("+25.0")


def test_a_study_is_a_page_of_the_report_with_its_tables(
    study: ReferenceResults, tmp_path: Path
) -> None:
    page = write_study(study, tmp_path).read_text(encoding="utf-8")
    assert "<title>Reference results: Known</title>" in page
    assert "a &amp; b" in page
    for part in ("findings", "curves", "tables", "run"):
        assert f'<section id="{part}">' in page
    names = {path.stem for path in (tmp_path / "tables").glob("*.csv")}
    assert names == {"metrics", "summary", "bd_rate", "bd_rate_clouds", "clouds"}
    assert len(pd.read_csv(tmp_path / "tables" / "metrics.csv")) == len(study.metrics)
    assert all(digest not in page.split('id="tables"')[0] for digest in study.clouds)
