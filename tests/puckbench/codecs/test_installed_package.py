"""A codec that another installed package brings, from its entry point to its curve."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CODEC = """
import numpy as np
from pydantic import Field
from puckbench.codecs.base import Codec, PointCloud
from puckbench.codecs.registry import CODECS
from pointkit.models import Model

class Options(Model):
    stretch: float = Field(1.0, gt=0)

@CODECS.register("raw")
class Raw(Codec):
    title = "Raw floats"
    colour = "#123456"
    marker = "*"
    rates = {"r1": {"kind": "<f2"}, "r2": {"kind": "<f4"}}
    magic = b"RAW"
    Options = Options

    def encode(self, cloud, rate):
        kind = self.rates[rate]["kind"]
        return b"RAW" + kind.encode() + (cloud.xyz * self.options.stretch).astype(kind).tobytes()

    def decode(self, stream):
        found = np.frombuffer(stream[6:], stream[3:6].decode()).reshape(-1, 3)
        return PointCloud(found.astype(float) / self.options.stretch)

class Bare(Codec):
    rates = {"r1": {}}

    def __init__(self, *, offset=0.0, **entry):
        super().__init__(**entry)
        self.offset = offset

    def encode(self, cloud, rate):
        return (cloud.xyz + self.offset).tobytes()

    def decode(self, stream):
        return PointCloud(np.frombuffer(stream).reshape(-1, 3) - self.offset)
"""

USED = """
import numpy as np
import puckbench.codecs.registry as registry
from pointkit.errors import InputError
from puckbench import PointCloud, decoded, encoded
from puckbench.figures.plot_styles import codec_rank, codec_style

points = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
cloud = PointCloud(points)
for name, changes in (("raw", {}), ("bare", {"options": {"offset": 1.5}})):
    codec = registry.open_codec(name, changes)
    assert np.array_equal(decoded(codec, encoded(codec, cloud, "r1")).xyz, points)
assert registry.codec_of(encoded(registry.open_codec("raw"), cloud, "r1")) == "raw"
assert registry.entry("raw") == {
    "class": "raw_points:Raw", "options": {"stretch": 1.0},
    "rates": {"r1": {"kind": "<f2"}, "r2": {"kind": "<f4"}},
}
assert registry.module_of(registry.entry("bare")["class"]) == "raw_points"
shown = codec_style("raw")
assert (shown.title, shown.colour, shown.marker) == ("Raw floats", "#123456", "*")
assert codec_style("bare").title == "bare"
assert codec_rank("draco") < codec_rank("bare") < codec_rank("raw")
for name, options in (("raw", {"strech": 2}), ("raw", {"stretch": 0}), ("bare", {"ofset": 1})):
    try:
        registry.entry(name, {"options": options})
    except InputError as error:
        print(error)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder with an installed package of two codecs."""
    about = tmp_path / "raw-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: raw\nVersion: 1\n")
    points = "raw = raw_points:Raw\nbare = raw_points:Bare\n"
    (about / "entry_points.txt").write_text(f"[puckbench.codecs]\n{points}")
    (tmp_path / "raw_points.py").write_text(CODEC)
    return tmp_path


def _python(package: Path, *words: str) -> str:
    search_path = os.environ.get("PYTHONPATH", "")
    environment = {**os.environ, "PYTHONPATH": f"{package}{os.pathsep}{search_path}"}
    command = [sys.executable, *words]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_is_titled_coded_recognised_and_checked(package: Path) -> None:
    assert _python(package, "-c", USED).splitlines() == [
        "codec raw: unknown option 'strech' (known: stretch); did you mean 'stretch'?",
        "codec raw: stretch is 0, but must be greater than 0",
        "codec bare: unknown option 'ofset'",
    ]


def test_it_is_listed_and_drawn(package: Path) -> None:
    listed = _python(package, "-m", "puckbench", "codecs").split("\n")
    assert "raw r1 to r2" in [" ".join(line.split()) for line in listed]
    program = """
import numpy as np
from puckbench.figures import panels
from puckbench.figures.style import FigureStyle
import matplotlib.pyplot as plt
style = FigureStyle()
figure, axes = plt.subplots()
for codec in style.ordered_codecs(["raw", "draco"]):
    panels.draw_line(axes, np.array([0.1, 0.2]), np.array([2.0, 1.0]), style.of_codec(codec))
print([line.get_color() for line in axes.lines])
"""
    assert "#123456" in _python(package, "-c", program)
