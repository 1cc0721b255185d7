"""Jobs run in the image that the configuration names, where Snakemake is told to use Apptainer."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.bench import Bench

APPTAINER = """#!/bin/sh
[ "$1" = --version ] && echo "apptainer version 1.3.4" && exit
while [ "$1" != exec ]; do shift; done
while case "$1" in *.sif) false ;; esac; do shift; done
echo "$1" >> {calls}
shift
exec "$@"
"""
"""A stand-in of the program: it notes the image, and runs the command outside of it."""


@pytest.fixture
def calls(fresh: Bench, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the stand-in notes."""
    noted, program = fresh.folder / "calls", fresh.folder / "bin" / "apptainer"
    program.parent.mkdir()
    program.write_text(APPTAINER.format(calls=noted))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    (fresh.folder / "mine.sif").touch()
    fresh.configure({"container": "mine.sif"})
    return noted


def test_jobs_run_in_the_image_of_the_configuration(fresh: Bench, calls: Path) -> None:
    fresh.made("--software-deployment-method", "apptainer", "--until", "scene")
    images = calls.read_text().splitlines()
    made = list((fresh.results / "scenes").rglob("*.ply"))
    assert len(made) == len(images) == 2
    assert {Path(image).name for image in images} == {"mine.sif"}


def test_without_that_option_they_run_without_an_image(fresh: Bench, calls: Path) -> None:
    fresh.made("--until", "scene")
    assert list((fresh.results / "scenes").rglob("*.ply"))
    assert not calls.exists()
