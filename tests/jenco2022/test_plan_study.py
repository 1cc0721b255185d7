"""The sensor study of a configuration: what is made of it, and its faults in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from jenco2022.steps.residuals import Residuals
from pointkit.errors import InputError
from puckbench.figures.registry import FIGURES
from puckbench.planning.workflow import Workflow

ROOT = Path(__file__).parents[2]
CHAPTER_5 = {name for name in FIGURES.names() if name.startswith("fig_5_")}


def workflow(study: dict[str, Any] | None) -> Workflow:
    return Workflow({"scene_sets": {}, "datasets": {}, "sensor_study": study})


def test_an_empty_study_makes_all_of_chapter_5() -> None:
    bench = workflow({})
    assert set(bench.outputs.figures) == CHAPTER_5
    assert len(CHAPTER_5) == 21
    assert {"table_4_1", "table_4_2", "table_5_1", "thesis_numbers"} <= set(
        bench.outputs.study_tables
    )
    assert list(bench.study.study.models) == [
        "none",
        "hdl64e",
        "vlp16",
        "vlp16_divergence",
        "vlp16_incidence",
    ]
    assert bench.study.study.all_distances_m == (1, 2, 3, 4, 5, 30)


def test_without_a_study_nothing_of_chapter_5_is_made() -> None:
    scenes = {"a": {"loader": "embedded_objects", "select": ["chair_01"]}}
    config = {"scene_sets": scenes, "datasets": {"d": {"scene_set": "a", "make": "sample"}}}
    for off in ({}, {"sensor_study": None}, {"sensor_study": False}):
        bench = Workflow({**config, **off})
        assert set(bench.outputs.figures) & CHAPTER_5 == set()
        assert bench.outputs.study_tables == {}


def test_only_figures_whose_scans_and_models_are_there_are_drawn() -> None:
    one_near = set(workflow({"distances_m": [2], "far_m": None}).outputs.figures)
    assert {"fig_5_1", "fig_5_10", "fig_5_20", "fig_5_21"} <= one_near
    assert one_near & {"fig_5_2", "fig_5_3", "fig_5_4", "fig_5_16", "fig_5_19"} == set()
    assert "incidence_effect" not in workflow({"distances_m": [2]}).outputs.study_tables
    without = set(workflow({"models": {"vlp16": None}}).outputs.figures)
    assert CHAPTER_5 - without == {"fig_5_19"}


def test_a_model_of_a_users_file_is_planned_and_fingerprinted(tmp_path: Path) -> None:
    source = """
from virtual_lidar.errors import ErrorModel
class TooFar(ErrorModel):
    share: float = 0.01
    def perturb_ranges(self, hits, sensor, draws):
        return hits.distance * (1 + self.share)
"""
    codes = []
    for name, text in (("a", source), ("b", source.replace("1 + self", "2 + self"))):
        place = f"{tmp_path / name}.py:TooFar"
        (tmp_path / f"{name}.py").write_text(text)
        bench = workflow({"models": {"far": {"errors": place, "error_options": {"share": 0.5}}}})
        job = bench.step("residuals", model="far")
        assert Residuals.model_validate_json(job.settings).errors == place
        codes.append(job.fingerprint)
    assert "TooFar(share=0.5)" in codes[0]
    assert codes[0] != codes[1]
    wrong = {"errors": f"{tmp_path / 'a'}.py:TooFar", "error_options": {"shear": 1}}
    with pytest.raises(InputError, match=r"models.far: .*unknown option 'shear' .known: share"):
        workflow({"models": {"far": wrong}})


def test_a_model_has_the_arguments_of_its_entry() -> None:
    models = {"wide": {"errors": "vlp16", "error_options": {"bias_sigma_m": 0.02}}}
    bench = workflow({"models": models, "runs": 1, "rows": 7, "refit": True, "seed": 5})
    job = bench.step("residuals", model="wide")
    assert Residuals.model_validate_json(job.settings) == Residuals(
        errors="vlp16",
        error_options={"bias_sigma_m": 0.02},
        seed=5,
        distances_m=(1, 2, 3, 4, 5, 30),
        runs=1,
        rows=7,
        refit=True,
    )
    assert "bias_sigma_m=0.02" in job.fingerprint


def test_captures_are_the_model_real(tmp_path: Path) -> None:
    capture = tmp_path / "a.pcap"
    capture.write_bytes(b"")
    bench = workflow({"captures": {"lab": {"path": str(capture)}}, "models": {"vlp16": {}}})
    residuals = bench.step("study_table", table="residuals").step
    assert residuals.names == (
        "residuals/models/vlp16.parquet",
        "residuals/captures/lab.parquet",
    )
    assert residuals.models == ("vlp16", "real")


@pytest.mark.parametrize(
    ("study", "message"),
    [
        ({"model": {}}, "sensor_study: unknown key 'model' .known: runs, rows, refit, seed"),
        ({"models": {"vlp61": {}}}, "sensor_study.models.vlp61: unknown error model 'vlp61'"),
        (
            {"models": {"a": {"errors": "vlp16", "error_options": {"bias": 1}}}},
            "sensor_study.models.a: error model vlp16: unknown",
        ),
        ({"models": {"real": {"errors": "vlp16"}}}, "sensor_study.models: 'real' is the name"),
        ({"distances_m": [7]}, r"sensor_study: no wall at 7 m \(there are 1, 2, 3, 4, 5, 30 m\)"),
        ({"distances_m": [30]}, r"sensor_study.distances_m.0 is 30, but must be less than 30"),
        ({"far_m": 5}, "sensor_study.far_m is 5, but must be greater than or equal to 30"),
        ({"runs": 0}, "sensor_study.runs is 0, but must be greater than or equal to 1"),
        ({"captures": {"a": {"path": "no.pcap"}}}, "sensor_study.captures.a: no.pcap: no such"),
        (None, "has no data set, no drive and no sensor study"),
    ],
)
def test_faults_are_one_line(study: dict[str, Any] | None, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        workflow(study)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["config.yaml", "chapter5.yaml", "thesis.yaml"])
def test_shipped_configurations_have_a_study(name: str) -> None:
    config = yaml.safe_load((ROOT / "config" / name).read_text())
    bench = workflow(config["sensor_study"])
    assert set(bench.outputs.figures) == CHAPTER_5
    # The author made one scan from each distance.
    assert bench.study.study.settings.runs == (3 if name == "config.yaml" else 1)


def test_capod_alone_has_none() -> None:
    assert "sensor_study" not in yaml.safe_load((ROOT / "config" / "capod.yaml").read_text())
