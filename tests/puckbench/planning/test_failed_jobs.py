"""What a plan leaves out after a job failed, and what it still makes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pointkit.errors import InputError
from puckbench.figures.registry import FIGURES
from puckbench.planning.workflow import Workflow
from puckbench.tables.registry import TABLES

OWN = """
from typing import TYPE_CHECKING

from puckbench.figures.registry import FIGURES
from puckbench.tables.registry import TABLES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@TABLES.register("few_bits")
def few_bits(metrics: "pd.DataFrame") -> "pd.DataFrame":
    return metrics


@FIGURES.register("of_few_bits")
def of_few_bits(few_bits: "pd.DataFrame", style: object) -> "Figure":
    raise KeyError
"""
TURN = [[0, 0, 0, 0, 0, 0, 0], [0.4, 0, 0.3, 0, 0, 0, 0]]
CONFIG: dict[str, Any] = {
    "thesis": True,
    "scene_sets": {
        "objects": {"loader": "embedded_objects", "select": ["airplane_01", "chair_01"]},
        "rooms": {"loader": "embedded_rooms", "select": ["office_1", "copy_room_1"]},
    },
    "datasets": {
        "objects": {"scene_set": "objects", "make": "sample", "seeds": [1, 2]},
        "noisy": {"scene_set": "rooms", "make": "scan", "errors": "vlp16"},
    },
    "drives": {
        "ways": {
            "scene_set": "rooms",
            "sweep": {"preset": "spin", "trajectory": TURN},
            "rates": ["20mm"],
        }
    },
    "codecs": {"draco": {}, "primitives": {}},
    "sensor_study": {"models": {"vlp16": {}, "vlp16_divergence": {}}},
    "figures": {"examples": {"object": "objects/chair_01-1", "noisy": "noisy/office_1"}},
    "bd_rate": {"anchor": "draco"},
    "train": {
        "first": {"codec": "pcgcv1", "datasets": ["objects"]},
        "second": {"codec": "pcgcv1", "datasets": ["noisy"], "start": "first"},
    },
}


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """The configuration with a table and a figure of its user, which other tests do not see."""
    file = tmp_path_factory.mktemp("own") / "bits_of_user.py"
    file.write_text(OWN)
    figures = {**CONFIG["figures"], "own": [f"{file}:of_few_bits"]}
    study = {**CONFIG["sensor_study"], "captures": {"mine": {"path": str(file)}}}
    changes = {"tables": [f"{file}:few_bits"], "figures": figures, "sensor_study": study}
    with pytest.MonkeyPatch.context() as registries:
        for registry in (TABLES, FIGURES):
            registries.setattr(registry, "_added", {})
        yield {**CONFIG, **changes}


def without(config: dict[str, Any], *jobs: str) -> Workflow:
    return Workflow({**config, "failed": {job: f"fault of {job}" for job in jobs}})


def files(bench: Workflow) -> set[str]:
    """All that a run makes, but for the tables of the plan, relative to the results."""
    outputs = bench.outputs
    rows = {name for table in outputs.gathered.values() for name in table.names}
    study = bench.study.gathered if bench.plan.study else {}
    rows |= {name for names in study.values() for name in names}
    tables = {f"tables/{name}" for name in (*outputs.gathered, *outputs.tables)}
    figures = {f"figures/{name}" for name in outputs.figures}
    coded = {*bench.plan.artefacts(), *bench.drives.artefacts()}
    return rows | tables | figures | coded | {f"weights/{name}" for name in bench.plan.trainings}


@pytest.fixture(scope="module")
def everything(own: dict[str, Any]) -> set[str]:
    return files(Workflow(own))


@pytest.mark.parametrize(
    ("job", "lost", "kept"),
    [
        (
            "scenes/objects/chair_01",
            {"metrics/objects/chair_01-1/draco.parquet", "clouds/objects/chair_01-2.json"},
            {"clouds/objects/airplane_01-1.json", "drive_tasks/ways/office_1-1/draco.parquet"},
        ),
        (
            "scenes/rooms/office_1",
            {"clouds/noisy/office_1.json", "drive_tasks/ways/office_1-1/draco.parquet"},
            {"clouds/noisy/copy_room_1.json", "drive_tasks/ways/copy_room_1-1/undecoded.parquet"},
        ),
        ("samples/objects/chair_01-1", {"coded/objects/chair_01-1/draco.zip"}, {"tables/clouds"}),
        (
            "scans/noisy/office_1",
            {"clouds/noisy/office_1.json", "recovery/noisy/office_1/primitives.parquet"},
            {"clouds/noisy/copy_room_1.json", "drive_tasks/ways/office_1-1/draco.parquet"},
        ),
        ("clouds/noisy/office_1", {"scan_errors/noisy/office_1.json"}, {"tables/scan_errors"}),
        (
            "coded/noisy/office_1/draco",
            {"coded/noisy/office_1/draco.zip", "metrics/noisy/office_1/draco.parquet"},
            {"metrics/noisy/office_1/primitives.parquet", "clouds/noisy/office_1.json"},
        ),
        (
            "metrics/noisy/office_1/draco",
            {"metrics/noisy/office_1/draco.parquet"},
            {"metrics/noisy/copy_room_1/draco.parquet"},
        ),
        (
            "recovery/noisy/office_1/primitives",
            {"recovery/noisy/office_1/primitives.parquet"},
            {"metrics/noisy/office_1/primitives.parquet", "tables/recovery"},
        ),
        ("scan_errors/noisy/office_1", {"scan_errors/noisy/office_1.json"}, {"tables/scan_errors"}),
        (
            "drives/ways/office_1-1",
            {"drive_tasks/ways/office_1-1/undecoded.parquet"},
            {"drive_tasks/ways/copy_room_1-1/undecoded.parquet", "clouds/noisy/office_1.json"},
        ),
        (
            "coded_drives/ways/office_1-1/draco",
            {"coded_drives/ways/office_1-1/draco.zip"},
            {"drive_tasks/ways/office_1-1/undecoded.parquet"},
        ),
        (
            "drive_tasks/ways/office_1-1/undecoded",
            {"drive_tasks/ways/office_1-1/undecoded.parquet"},
            {"drive_tasks/ways/office_1-1/draco.parquet"},
        ),
        (
            "residuals/models/vlp16",
            {"residuals/models/vlp16.parquet", "wall_points/vlp16.parquet"},
            {"residuals/models/vlp16_divergence.parquet", "tables/table_5_1"},
        ),
        (
            "tables/residuals",
            {"figures/fig_5_10", "tables/residual_statistics"},
            {"figures/fig_5_1"},
        ),
        (
            "tables/metrics",
            {"tables/metrics", "tables/summary", "tables/few_bits"},
            {"tables/clouds"},
        ),
        ("tables/few_bits", {"tables/few_bits", "figures/of_few_bits"}, {"tables/summary"}),
        ("figures/of_few_bits", {"figures/of_few_bits"}, {"tables/few_bits"}),
        (
            "residuals/captures/mine",
            {"residuals/captures/mine.parquet", "tables/model_distances"},
            {"residuals/models/vlp16.parquet"},
        ),
        (
            "tables/compared_residuals",
            {"tables/model_distances", "figures/model_verdict"},
            {"residuals/captures/mine.parquet"},
        ),
        ("tables/model_distances", {"figures/model_verdict"}, {"tables/residual_statistics"}),
        ("weights/first", {"weights/first", "weights/second"}, {"tables/metrics"}),
    ],
)
def test_what_a_failed_job_makes_is_left_out_and_the_rest_is_made(
    job: str, lost: set[str], kept: set[str], own: dict[str, Any], everything: set[str]
) -> None:
    assert everything >= lost | kept
    bench = without(own, job)
    assert not files(bench) & lost
    assert files(bench) >= kept
    assert [row for row in bench.outputs.left_out_rows if row["reason"] == f"fault of {job}"]
    assert set(bench.outputs.report_contents.tables) <= {
        *bench.outputs.gathered,
        *bench.outputs.tables,
    }


def test_a_data_set_without_clouds_is_left_out_with_its_examples_and_trainings(
    own: dict[str, Any],
) -> None:
    bench = without(own, "scans/noisy/office_1", "scans/noisy/copy_room_1")
    assert list(bench.plan.datasets) == ["objects"]
    assert bench.plan.examples == {"object": "objects/chair_01-1"}
    assert bench.plan.trainings["second"].clouds == ()


def test_tables_and_figures_that_need_a_failed_table_are_listed(own: dict[str, Any]) -> None:
    rows = without(own, "tables/few_bits").outputs.left_out_rows
    reasons = {row["file"]: row["reason"] for row in rows}
    assert reasons["table few_bits"] == "fault of tables/few_bits"
    assert reasons["figure of_few_bits"] == "needs the table few_bits, which is left out"


def test_an_anchor_without_results_is_replaced_by_the_first_codec() -> None:
    config = {**CONFIG, "drives": {}}
    clouds = [
        f"coded/objects/{name}-{seed}" for name in ("airplane_01", "chair_01") for seed in (1, 2)
    ]
    clouds += ["coded/noisy/office_1", "coded/noisy/copy_room_1"]
    bench = without(config, *(f"{cloud}/draco" for cloud in clouds))
    assert bench.outputs.anchor == bench.outputs.first_codec == "primitives"


def test_without_any_result_there_is_still_a_report_of_what_failed() -> None:
    scenes = {"chairs": {"loader": "embedded_objects", "select": ["chair_01"]}}
    config = {"scene_sets": scenes, "datasets": {"d": {"scene_set": "chairs", "make": "sample"}}}
    contents = without(config, "scenes/chairs/chair_01").outputs.report_contents
    assert (contents.metrics, list(contents.tables), contents.figures) == (
        None,
        ["left_out"],
        {},
    )


def test_a_mistake_in_the_configuration_is_told_after_a_failure_too() -> None:
    anchor = {**CONFIG, "bd_rate": {"anchor": "drako"}}
    with pytest.raises(InputError, match=r"bd_rate\.anchor: no codec 'drako'"):
        without(anchor, "scenes/rooms/office_1")


def test_an_input_of_a_users_figure_that_does_not_exist_is_one_line(
    own: dict[str, Any], tmp_path: Path
) -> None:
    file = tmp_path / "another_of_user.py"
    file.write_text(OWN.replace("few_bits: ", "result: ").replace("of_few_bits", "of_result"))
    figures = {**CONFIG["figures"], "own": [f"{file}:of_result"]}
    with pytest.raises(InputError, match=r"figure .*:of_result: no table 'result'"):
        Workflow({**own, "figures": figures})
