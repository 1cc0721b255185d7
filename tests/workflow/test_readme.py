"""The examples of the README do what it says."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import yaml

from tests.workflow.conftest import ROOT, Bench

README = (ROOT / "README.md").read_text(encoding="utf-8")


def _blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_a_codec_and_a_data_set_of_ones_own_run_as_the_readme_shows(fresh: Bench) -> None:
    for block in _blocks("python"):
        name = block.split('"""')[1].split(":")[0]
        path = fresh.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(block)
    shown = [yaml.safe_load(block) for block in _blocks("yaml")]
    codecs = next(block["codecs"] for block in shown if "codecs" in block)
    scenes = next(block["scenes"] for block in shown if "spheres" in block.get("scenes", {}))
    fresh.configure(
        {
            "scenes": scenes,
            "datasets": {"spheres": {"scenes": "spheres", "make": "sample", "points": 1000}},
            "codecs": {"grid": codecs["grid"]},
            "figures": {},
            "sensor_study": None,
        }
    )
    fresh.made("tables")
    table = pd.read_csv(fresh.results / "tables" / "metrics.csv")
    assert len(table) == 3 * 3
    coarse = table[table.cloud == "coarse"].set_index("rate")
    assert coarse.bpp.is_monotonic_increasing
    assert coarse.d1_mse.is_monotonic_decreasing


def test_files_that_the_readme_names_exist() -> None:
    named = set(re.findall(r"`((?:src|config|workflow|docs)/[\w./-]+)`|\]\(([\w./]+)\)", README))
    for path in {first or second for first, second in named}:
        assert (ROOT / path).exists(), path


def test_the_default_configuration_has_the_paths_that_the_readme_names() -> None:
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    assert "office_1" in config["scenes"]["rooms"]["select"]
    assert "rooms_noisy" in config["datasets"]
    assert Path(ROOT / "config" / "README.md").exists()
