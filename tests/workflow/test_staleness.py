"""Which jobs run again when puckbench's own code changes: what it makes, and nothing else."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.bench import ROOT, Bench

TABLE = '''"""One more table."""

from puckbench.metrics.table_registry import TABLES


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
    (
        copied.snakefile.parents[1] / "src" / "puckbench" / "metrics" / "tables" / "streams.py"
    ).write_text(TABLE)
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
