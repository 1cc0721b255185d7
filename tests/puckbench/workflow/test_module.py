"""The workflow as a module of another one, and what the workflow catalogue asks for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import yaml

import puckbench
from puckbench.core.packages import ENGINES, packages_alone
from tests.support.bench import ROOT
from tests.support.pages import blocks

CONFIG = {
    "results": "benchmark",
    "scene_sets": {"objects": {"loader": "embedded_objects", "select": ["chair_01"]}},
    "datasets": {"objects": {"scene_set": "objects", "make": "sample", "points": 2000}},
    "codecs": {"draco": {"rates": ["r1", "r8"]}},
}


def snakemake(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "snakemake", "--cores", "2", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_another_workflow_uses_this_one_as_the_page_shows(tmp_path: Path) -> None:
    (tmp_path / "puckbench").symlink_to(ROOT)
    (tmp_path / "Snakefile").write_text(blocks("docs/how-to/use_as_a_library.md", "snakemake")[0])
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "config.yaml").write_text(yaml.safe_dump({"puckbench": CONFIG}))
    done = snakemake(tmp_path)
    assert done.returncode == 0, done.stderr[-4000:]
    table = pd.read_csv(tmp_path / "ranking.csv")
    assert table.shape[0] == 2
    assert (tmp_path / "benchmark" / "coded" / "objects" / "chair_01" / "draco.zip").exists()
    assert "Nothing to be done" in snakemake(tmp_path, "--dry-run").stdout


def test_an_environment_that_snakemake_deploys_has_puckbench_and_nothing_beside_it(
    tmp_path: Path,
) -> None:
    """As where the module is fetched from a repository: the installed package serves."""
    folder = packages_alone(tmp_path / "packages")
    assert packages_alone(tmp_path / "packages") == folder
    assert {path.name for path in folder.iterdir()} == {
        *("puckbench", *ENGINES, "jenco2022", "jenco2022.dist-info"),
    }
    bare = [sys.executable, "-S", "-c", "import puckbench; print(puckbench.__version__)"]
    env = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(bare, capture_output=True, text=True, env=env, check=False)
    assert done.stdout.strip() == puckbench.__version__


def test_the_linter_is_content_with_the_repository_as_the_catalogue_runs_it() -> None:
    done = snakemake(ROOT, "--lint")
    assert done.returncode == 0, done.stderr
    assert "good condition" in done.stdout + done.stderr


def test_the_catalogue_finds_what_standard_usage_asks_for() -> None:
    usage = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text())["usage"]
    assert usage["software-stack-deployment"]["conda"] is True
    assert usage["software-stack-deployment"]["report"] is True
    assert isinstance(usage["mandatory-flags"]["flags"], str)
    assert (ROOT / "workflow" / "Snakefile").is_file()
    assert (ROOT / "config" / "README.md").is_file()
    assert (ROOT / "config" / "config.yaml").is_file()
    assert list((ROOT / "workflow" / "rules").glob("*.smk"))
    # With this, `snakemake --directory .test --rulegraph` draws the workflow on its page.
    assert (ROOT / ".test" / "config" / "config.yaml").resolve() == ROOT / "benchmarks/small.yaml"
    words = (ROOT / "README.md").read_text(encoding="utf-8").lower()
    assert "snakemake" in words
    assert "workflow" in words
