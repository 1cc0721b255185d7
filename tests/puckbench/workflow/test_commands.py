"""What a dry run prints can be typed, and a dry run writes nothing."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.bench import ROOT, Bench

SCENE = "results/scenes/objects/chair_01.ply"
SAMPLE = "results/samples/objects/chair_01.ply"


@pytest.fixture
def alone(tmp_path: Path) -> Bench:
    """A folder in which nothing was made."""
    return Bench(tmp_path)


def test_commands_of_a_dry_run_make_what_they_say(alone: Bench) -> None:
    before = {*alone.folder.rglob("*")}
    done = alone.snakemake("--dry-run", "--printshellcmds", SAMPLE)
    assert done.returncode == 0, done.stderr[-4000:]
    made = {path for path in alone.folder.rglob("*") if path.is_file()} - before
    # what Snakemake and Python keep for themselves
    assert {path.parent.name for path in made} <= {"iocache", "__pycache__"}
    lines = (done.stdout + done.stderr).splitlines()
    commands = [line.partition(": ")[2] for line in lines if line.startswith("Shell command: ")]
    assert [shlex.split(command)[3] for command in commands] == ["scene", "sample"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    environment["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    for command in commands:
        for word in shlex.split(command):  # Snakemake makes the folders
            place = alone.folder / word.rpartition("=")[2]
            place.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(["bash", "-c", command], cwd=alone.folder, env=environment, check=True)
    assert alone.planned(SAMPLE) == {}


def test_settings_that_are_too_long_for_a_command_are_in_a_file(alone: Bench) -> None:
    alone.configure({"report": {"title": "long " * 13_000}})
    done = alone.snakemake("--dry-run", "--printshellcmds", "results/report.html")
    assert done.returncode == 0, done.stderr[-4000:]
    (command,) = (
        line for line in done.stdout.splitlines() if "puckbench.steps report_page" in line
    )
    assert "report_page @results/.settings/" in command
    assert len(command) < 1000
    assert not alone.results.exists()
