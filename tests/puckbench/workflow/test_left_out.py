"""Faults of a user's error model, table and figure: everything else is made."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from pointkit.yaml_files import read_yaml
from tests.support.bench import ROOT

OWN = """
import sys
from typing import TYPE_CHECKING

from puckbench.codecs.base import Codec
from virtual_lidar.errors.model import ErrorModel

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Breaks(ErrorModel):
    def perturb_ranges(self, hits, sensor, draws):
        return hits.distance + {}["offset"]


class Exits(Codec):
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        sys.exit(0)

    def decode(self, stream):
        raise NotImplementedError


def odd_table(metrics: "pd.DataFrame") -> "pd.DataFrame":
    return {}["table"]


def of_odd_table(odd_table: "pd.DataFrame", style: object) -> "Figure":
    raise NotImplementedError


def odd_figure(metrics: "pd.DataFrame", style: object) -> "Figure":
    return {}["figure"]
"""
CONFIG: dict[str, Any] = {
    "scene_sets": {"objects": {"loader": "embedded_objects", "select": ["chair_01"]}},
    "datasets": {"objects": {"scene_set": "objects", "make": "sample", "points": 2000}},
    "codecs": {"draco": {"rates": ["r1", "r8"]}},
    "timing": {"repeats": 1},
}
ROOMS = {"loader": "embedded_rooms", "options": {"rooms": ["copy_room_1"], "detail": 0.3}}


def _run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=False,
    )


def _configured(folder: Path, **changes: Any) -> None:
    (folder / "faults.py").write_text(OWN)
    (folder / "mine.yaml").write_text(yaml.safe_dump({**CONFIG, **changes}, sort_keys=False))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, int]:
    """A run with four faults: its folder, output and status."""
    folder = tmp_path_factory.mktemp("left_out")
    noisy = {"scene_set": "rooms", "make": "scan", "errors": "faults.py:Breaks"}
    figures = {
        "own": ["faults.py:odd_figure", "faults.py:of_odd_table"],
        "examples": {"noisy": "noisy/copy_room_1", "object": "objects/chair_01"},
    }
    _configured(
        folder,
        scene_sets={**CONFIG["scene_sets"], "rooms": ROOMS},
        datasets={**CONFIG["datasets"], "noisy": {**noisy, "sweep": {"duration_s": 0.02}}},
        tables=["faults.py:odd_table"],
        figures=figures,
    )
    done = _run(folder, "puckbench", "run", "mine.yaml", "--cores", "2")
    return folder, done.stdout, done.returncode


def test_every_fault_is_listed_with_its_reason(finished: tuple[Path, str, int]) -> None:
    folder, output, status = finished
    assert status == 1
    table = pd.read_csv(folder / "results" / "tables" / "left_out.csv")
    reasons = dict(zip(table["file"], table["reason"], strict=True))
    assert reasons.keys() == {
        "scan noisy/copy_room_1",
        "table odd_table",
        "figure odd_figure",
        "figure of_odd_table",
    }
    assert reasons["scan noisy/copy_room_1"].startswith("KeyError: 'offset' (faults.py:")
    assert reasons["table odd_table"].startswith("KeyError: 'table' (faults.py:")
    assert reasons["figure odd_figure"].startswith("KeyError: 'figure' (faults.py:")
    assert reasons["figure of_odd_table"] == "needs the table odd_table, which is left out"
    for file, reason in reasons.items():
        assert f"left out: {file}: {reason}" in output


def test_everything_else_is_made(finished: tuple[Path, str, int]) -> None:
    folder, output, _ = finished
    results = folder / "results"
    assert set(pd.read_csv(results / "tables" / "summary.csv")["dataset"]) == {"objects"}
    assert (results / "figures" / "chamfer_rd.pdf").is_file()
    assert "KeyError: &#39;offset&#39;" in (results / "report.html").read_text()
    assert "report:  results/report.html" in output


def test_the_printed_command_makes_the_rest_of_this_run(tmp_path: Path) -> None:
    codecs = {**CONFIG["codecs"], "exits": {"class": "faults.py:Exits"}}
    _configured(tmp_path, codecs=codecs)
    snakefile = str(ROOT / "workflow" / "Snakefile")
    words = ["tables", "--snakefile", snakefile, "--configfile", "mine.yaml", "--cores", "2"]
    done = _run(tmp_path, "snakemake", *words, "--config", "seed=7", "results=here too")
    assert done.returncode == 1
    (line,) = [each for each in done.stderr.splitlines() if "report without them: " in each]
    program, *words = shlex.split(line.partition("without them: ")[2])
    assert program == "snakemake"
    assert words[-3:] == ["--configfile", "mine.yaml", "here too/failed.yaml"]
    assert _run(tmp_path, program, *words).returncode == 0
    assert not (tmp_path / "results").exists()
    tables = tmp_path / "here too" / "tables"
    assert set(pd.read_csv(tables / "metrics.csv")["codec"]) == {"draco"}
    assert set(pd.read_csv(tables / "left_out.csv")["file"]) == {
        "codec exits, cloud objects/chair_01"
    }
    assert list(read_yaml(tmp_path / "here too" / "failed.yaml")["failed"]) == [
        "coded/objects/chair_01/exits"
    ]
    cloud = tmp_path / "here too" / "clouds" / "objects" / "chair_01.json"
    assert read_yaml(cloud)["seed"] == 7
