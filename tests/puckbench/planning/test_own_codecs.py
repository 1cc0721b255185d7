"""Codecs of a user's own file in a configuration."""

from pathlib import Path

import pytest
import yaml

from puckbench.cli import main
from puckbench.figures.plot_styles import PlotStyle, read_looks
from puckbench.figures.style import FigureStyle
from puckbench.planning.workflow import Workflow
from puckbench.steps.results_table import ResultsTable

ROOT = Path(__file__).parents[3]

MINE = """
from puckbench.codecs.base import Codec

class Mine(Codec):
    title = "Mine"
    colour = "#123456"
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        return cloud.xyz.tobytes()

    def decode(self, stream):
        return []
"""


HELPED = """
import numpy as np
from puckbench.codecs.base import Codec, PointCloud
{early}

class Helped(Codec):
    title = "Helped"
    rates = {{"r1": {{}}}}

    def encode(self, cloud, rate):
        {late}
        return {name}.STEP.to_bytes() + cloud.xyz.astype("<f8").tobytes()

    def decode(self, stream):
        return PointCloud(np.frombuffer(stream[1:], "<f8").reshape(-1, 3))
"""


def helped(file: Path, early: str, late: str, name: str) -> str:
    file.parent.mkdir(exist_ok=True)
    file.write_text(HELPED.format(early=early, late=late, name=name))
    return f"{file}:Helped"


def coded(folder: Path, codec: str) -> bytes:
    """A cloud coded by the command line."""
    (folder / "a.xyz").write_text("1 2 3\n4 5 6\n")
    words = [str(folder / "a.xyz"), str(folder / "a.bin"), "--codec", codec, "--rate", "r1"]
    assert main(["encode", *words]) == 0
    return (folder / "a.bin").read_bytes()


def test_a_codec_imports_what_lies_beside_its_file_as_it_is_loaded_and_later(
    tmp_path: Path,
) -> None:
    (tmp_path / "early_step.py").write_text("STEP = 7\n")
    (tmp_path / "late_step.py").write_text("STEP = 8\n")
    early = helped(tmp_path / "early.py", "import early_step", "pass", "early_step")
    late = helped(tmp_path / "late.py", "", "import late_step", "late_step")
    assert [coded(tmp_path, codec)[0] for codec in (early, late)] == [7, 8]


def test_a_codec_imports_modules_of_its_package(tmp_path: Path) -> None:
    (tmp_path / "stepping").mkdir()
    (tmp_path / "stepping" / "__init__.py").write_text("")
    (tmp_path / "stepping" / "steps.py").write_text("STEP = 9\n")
    place = helped(tmp_path / "stepping" / "codec.py", "from . import steps", "pass", "steps")
    assert coded(tmp_path, place)[0] == 9


def test_two_codecs_with_helpers_of_one_name_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, folder in enumerate(("first", "second")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same_name.py").write_text(f"STEP = {number}\n")
        place = helped(tmp_path / folder / "mine.py", "", "import same_name", "same_name")
        if folder == "first":
            assert coded(tmp_path, place)[0] == 0
    (tmp_path / "a.bin").unlink()
    words = [str(tmp_path / "a.xyz"), str(tmp_path / "a.bin"), "--codec", place, "--rate", "r1"]
    assert main(["encode", *words]) == 2
    hidden = f"{tmp_path}/second/same_name.py is hidden by {tmp_path}/first/same_name.py"
    assert hidden in capsys.readouterr().err


def test_figures_show_a_codec_of_a_file_as_its_class_says(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    config["drives"] = {}  # of codecs that are gone
    config["codecs"] = {"gpcc": {}, "mine": {"class": f"{tmp_path}/mine.py:Mine"}}
    base = Workflow(config).outputs.figure_style("fig_6_6")[0]
    assert base["codec_titles"] == {"mine": "Mine"}
    assert base["colours"] == {"mine": "#123456"}
    assert base["markers"].keys() == base["lines"].keys() == {"mine"}
    config["codecs"] = {"gpcc": {}}
    assert "colours" not in Workflow(config).outputs.figure_style("fig_6_6")[0]


def test_a_configuration_changes_the_looks_of_a_codec() -> None:
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    config["drives"] = {}  # of codecs that are gone
    config["codecs"] = {"gpcc": {}, "draco": {"title": "D", "marker": "*", "colour": "#010203"}}
    style = Workflow(config).outputs.titles
    shown = style.of_codec("draco")
    assert (shown.title, shown.marker, shown.colour) == ("D", "*", "#010203")
    assert style.of_codec("gpcc").title == "G-PCC"


def test_another_codec_draws_only_figures_again_that_show_codecs(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    config["drives"] = {}  # of codecs that are gone
    config["codecs"] = {"gpcc": {}}
    before = Workflow(config)
    config["codecs"] |= {"mine": {"class": f"{tmp_path}/mine.py:Mine"}}
    after = Workflow(config)
    for figure, is_equal in (("fig_6_4", True), ("fig_6_6", False)):
        keys = {flow.step("figure", figure=figure).key for flow in (before, after)}
        assert (len(keys) == 1) == is_equal


def test_figures_that_are_drawn_later_show_codecs_as_the_run_did(tmp_path: Path) -> None:
    row = {"codec": "mine", "title": "Mine", "colour": "#123456", "marker": "*", "line": ":"}
    files = (tmp_path / f"codecs.{suffix}" for suffix in ("csv", "parquet", "columns.csv"))
    ResultsTable(table="codecs", rows=(row,)).run(tmp_path, *files)
    style = FigureStyle.from_config(read_looks(tmp_path))
    assert style.of_codec("mine") == PlotStyle("Mine", "#123456", "*", ":")
    assert read_looks(tmp_path / "elsewhere") == {}
