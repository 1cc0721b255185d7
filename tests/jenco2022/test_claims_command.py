"""`puckbench claims` and the tables that it prints, and which tables a configuration can have."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from puckbench.cli import main
from puckbench.planning.workflow import Workflow

ROOT = Path(__file__).parents[2]


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """A folder of results with a table of claims, made of one data set of Draco's."""
    metrics = pd.DataFrame(
        {
            "dataset": "objects",
            "cloud": [cloud for cloud in ("chair", "table", "lamp", "plane") for _ in range(4)],
            "codec": "draco",
            "rate": 4 * ["r1", "r2", "r3", "r4"],
            "bpp": 4 * [0.1, 0.2, 0.5, 1.0],
            "cd_plane": 4 * [10.0, 5.0, 2.0, 1.0],
        }
    )
    metrics.to_csv(tmp_path / "metrics.csv", index=False)
    options = {"datasets": {"objects": "objects"}, "codecs": {"draco": "draco"}}
    words = ["--inputs", json.dumps({"metrics": str(tmp_path / "metrics.csv")})]
    words += ["--options", json.dumps(options)]
    (tmp_path / "tables").mkdir()
    assert main(["table", "claims", str(tmp_path / "tables" / "claims.csv"), *words]) == 0
    return tmp_path


def test_claims_are_printed_for_a_terminal(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["claims", str(results)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    assert [line.split()[0] for line in lines if line[:1].isdigit()] == [
        str(number) for number in range(1, 15)
    ]
    assert (
        "    - Draco improves: yes (CD falls 10 times from first to last rate) [4 clouds, 4 rates]"
        in lines
    )
    assert "    HOLDS IN PART" in lines


def test_a_claim_is_not_broken_inside_parentheses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here = "rises: yes (1 to 2 m); falls: no (0.1 to 0.2 m; real 0.3 m) [7 rows]"
    row = {"number": 4, "claim": "It rises.", "verdict": "holds", "here": here}
    pd.DataFrame([row]).to_csv(tmp_path / "claims.csv", index=False)
    assert main(["claims", str(tmp_path / "claims.csv")]) == 0
    parts = [line for line in capsys.readouterr().out.splitlines() if line.startswith("    - ")]
    assert parts == [
        "    - rises: yes (1 to 2 m)",
        "    - falls: no (0.1 to 0.2 m; real 0.3 m) [7 rows]",
    ]


def test_claims_as_json(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    path = str(results / "tables" / "claims.csv")
    assert main(["claims", path, "--json"]) == 0
    row = json.loads(capsys.readouterr().out)["claims"][11]
    assert row["number"] == "12"
    assert row["verdict"] == "not tested: needs an object set and scans"


def test_what_is_no_table_of_claims_ends_in_one_line(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    for path in (results / "metrics.csv", results / "nowhere"):
        assert main(["claims", str(path)]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first.endswith("metrics.csv: not a table of claims (no column 'number')")
    assert second.endswith(
        "nowhere/tables/claims.csv: no such file; a run makes it with the key `thesis: true`"
    )


def opened(**changes: Any) -> Workflow:
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    return Workflow({**config, "drives": {}, **changes})


def test_a_configuration_tells_what_plays_which_part() -> None:
    bench = opened()
    options = bench.outputs.table_options("claims")
    assert options["datasets"] == {
        "objects": "objects",
        "rooms_raw": "sampled rooms",
        "rooms_clean": "clean scans",
        "rooms_noisy": "noisy scans",
    }
    assert options["codecs"] == {
        "draco": "draco",
        "gpcc": "gpcc",
        "gpcc_as_run": "gpcc_arena",
    }
    assert options["stand_ins"] == {"pcgcv1": "pcgcv1_plus", "pcgcv2": "pcgcv2_plus"}
    scales = bench.outputs.table_options("gpcc_scales")["scales"]
    assert scales["gpcc_arena"]["r3"] == 0.375
    assert set(scales) == {"gpcc", "gpcc_arena"}


def test_the_table_of_claims_takes_what_a_run_has() -> None:
    tables = {"residual_statistics", "thesis_numbers", "incidence_effect"}
    assert set(opened().outputs.result_tables["claims"]) == {"metrics", "clouds", *tables}
    study = opened(scene_sets={}, datasets={}, figures={})
    assert set(study.outputs.result_tables) == {"claims"}
    assert set(study.outputs.result_tables["claims"]) == tables
    without = opened(sensor_study=None, codecs={"draco": {}})
    tables = {
        "claims",
        "thesis_medians",
        "machines",
        "nearest_truth",
        "perception_bits",
        "perception_losses",
        "rates",
        "segmentation_scores",
        "storage",
        "summary",
    }
    assert set(without.outputs.result_tables) == tables
    assert set(without.outputs.result_tables["claims"]) == {"metrics", "clouds"}
    assert not {"gpcc_grid", "gpcc_rounding"} & set(without.outputs.figures)


def test_one_g_pcc_alone_has_scales_but_nothing_to_compare() -> None:
    figures = opened(codecs={"draco": {}, "gpcc": {}}).outputs.figures
    assert "gpcc_grid" in figures
    assert "gpcc_rounding" not in figures
