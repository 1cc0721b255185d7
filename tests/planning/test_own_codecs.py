"""Codecs of a user's own file in a configuration."""

from pathlib import Path

import yaml

from puckbench.planning.workflow import Workflow

ROOT = Path(__file__).parents[2]

MINE = """
from puckbench.codecs.base import Codec

class Mine(Codec):
    title = "Mine"
    colour = "#123456"
    rates = {"r1": {}}

    def _encode(self, points, parameters):
        return points.tobytes()

    def _decode(self, stream):
        return []
"""


def test_figures_show_a_codec_of_a_file_as_its_class_says(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    config["codecs"] = {"gpcc": {}, "mine": {"class": f"{tmp_path}/mine.py:Mine"}}
    base = Workflow(config).outputs.figure_style("fig_6_6")[0]
    assert base["codec_titles"] == {"mine": "Mine"}
    assert base["colours"] == {"mine": "#123456"}
    config["codecs"] = {"gpcc": {}}
    assert "colours" not in Workflow(config).outputs.figure_style("fig_6_6")[0]
