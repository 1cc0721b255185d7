"""The process of a job with a plug-in that does what it should not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import trust
from puckbench.cli import main as command
from puckbench.results.curves import read_curve
from puckbench.steps.process import main

OWN = """
import os
import sys
from pathlib import Path

from puckbench.codecs.base import Codec


class Own(Codec):
    rates = {
        "r1": {"do": "move"},
        "r2": {"do": "exit"},
        "r3": {"do": "stop"},
        "r4": {"do": "remove"},
    }

    def encode(self, cloud, rate):
        if self.rates[rate]["do"] == "move":
            os.chdir(os.path.dirname(__file__))
        if self.rates[rate]["do"] == "exit":
            sys.exit()
        if self.rates[rate]["do"] == "stop":
            sys.exit("no licence")
        if self.rates[rate]["do"] == "remove":
            Path("cloud.ply").unlink(missing_ok=True)
        return b"coded"

    def decode(self, stream):
        raise ValueError
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a cloud; the user's codec is in another."""
    work, plugins = tmp_path / "work", tmp_path / "plugins"
    work.mkdir()
    plugins.mkdir()
    (plugins / "own.py").write_text(OWN)
    points = np.random.default_rng(0).random((10, 3)) * 1023
    write_cloud(work / "cloud.ply", PointCloud(points, about={"size": 1024}))
    place = f"{plugins}/own.py:Own"
    trust([place])
    for rate in ("r1", "r2", "r3", "r4"):
        settings = {"codec": "own", "entry": {"class": place, "rates": [rate]}, "repeats": 2}
        (work / f"{rate}.json").write_text(json.dumps(settings))
    monkeypatch.chdir(work)
    return work


def _status(rate: str) -> int:
    return main(["encode", f"@{rate}.json", "cloud=cloud.ply", "curve=out.zip"])


def test_files_are_where_they_were_asked_for_though_a_plug_in_changes_the_folder(
    folder: Path,
) -> None:
    assert _status("r1") == 0
    assert read_curve(folder / "out.zip")["r1"].stream == b"coded"


def test_a_command_writes_where_it_was_asked_to_though_a_codec_changes_the_folder(
    folder: Path,
) -> None:
    words = [
        "cloud.ply",
        "out.bin",
        "--codec",
        f"{folder.parent}/plugins/own.py:Own",
        "--rate",
        "r1",
    ]
    assert command(["encode", *words]) == 0
    assert (folder / "out.bin").read_bytes() == b"coded"


@pytest.mark.parametrize(
    ("rate", "line"),
    [("r2", "SystemExit: exit status 0 (own.py:"), ("r3", "SystemExit: exit status no licence (")],
)
def test_a_plug_in_that_ends_the_process_has_failed(
    rate: str, line: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _status(rate) == 2
    (last,) = capsys.readouterr().err.splitlines()
    assert last.startswith(f"puckbench: rate {rate}: codec own: {line}")
    assert not (folder / "out.zip").exists()


def test_a_job_without_one_of_its_files_has_failed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _status("r4") == 2
    output = capsys.readouterr()
    assert output.err == "puckbench: cloud.ply: the step ended without this file\n"
    assert output.out == ""


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["sample", "{}"], "the step needs mesh=FILE, cloud=FILE"),
        (["sample", "{}", "mesh=a", "nokey=b", "cloud=c"], "nokey=b: the step has no file 'nokey'"),
        (["sample", "{}", "a"], "a: must be key=FILE"),
        (["sample", "{"], "the settings: not valid JSON"),
        (["sample", "@nowhere.json"], "nowhere.json: no such file"),
        (["nothing", "{}"], "unknown step 'nothing'"),
        (["sample"], "usage: python -m puckbench.steps NAME SETTINGS key=FILE ..."),
    ],
)
def test_a_command_that_is_wrong_is_one_line(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"puckbench: {line}")
    assert said.count("\n") == 1
