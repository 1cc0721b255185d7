"""The tutorials run from beginning to end, each in a folder of its own."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import nbformat
import pytest
from myst_nb.core.read import read_myst_markdown_notebook
from myst_parser.config.main import MdParserConfig
from nbclient import NotebookClient

from tests.support.pages import ROOT, page

TUTORIALS = sorted(
    path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md") if path.stem != "index"
)
SHORTER = {
    "my_network": {
        "steps: 1000": "steps: 20",
        "points: 100000": "points: 20000",
        "airplane_05, chair_05, lamp_05, table_05, vase_05": "chair_05",
        "chair_01, vase_01": "chair_01",
    }
}
"""What is replaced on a page so that it runs within seconds."""


def _ran(name: str, folder: Path) -> nbformat.NotebookNode:
    text = page(f"docs/tutorials/{name}.md")
    for shown, shorter in SHORTER.get(name, {}).items():
        assert shown in text
        text = text.replace(shown, shorter)
    notebook = read_myst_markdown_notebook(text, MdParserConfig(), add_source_map=False)
    client = NotebookClient(
        notebook, timeout=1200, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    return client.execute()


@pytest.fixture
def at_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernels find this puckbench, and its commands."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for name, value in {
        "PATH": path,
        "PYTHONPATH": str(ROOT / "src"),
        "PUCKBENCH": str(ROOT),
    }.items():
        monkeypatch.setenv(name, value)


@pytest.mark.filterwarnings("default")
@pytest.mark.usefixtures("at_work", "job_server")
@pytest.mark.parametrize("name", TUTORIALS)
def test_a_tutorial_runs(name: str, tmp_path: Path) -> None:
    cells = [cell for cell in _ran(name, tmp_path).cells if cell.cell_type == "code"]
    assert cells
    assert all(cell.execution_count for cell in cells)


def test_there_are_the_tutorials_that_the_index_lists() -> None:
    index = page("docs/tutorials/index.md")
    assert len(TUTORIALS) == 8
    assert all(f"\n{name}\n" in index for name in TUTORIALS)
