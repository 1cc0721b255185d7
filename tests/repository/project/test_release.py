"""The version is said once and repeated rightly; recipes of images hold what they install."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

import puckbench

ROOT = Path(__file__).resolve().parents[3]
DOCKERFILE, APPTAINER = ROOT / "envs" / "Dockerfile", ROOT / "envs" / "apptainer.def"
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
ZENODO = json.loads((ROOT / ".zenodo.json").read_text())
SECTION = re.compile(r"^## \[(.+?)\](?: - (.+))?$", re.MULTILINE)


def test_the_version_is_the_same_everywhere() -> None:
    sections = SECTION.findall((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert sections[0] == ("Unreleased", "")
    version, date = sections[1]
    assert version == puckbench.__version__ == str(CITATION["version"]) == ZENODO["version"]
    assert date == CITATION["date-released"] == ZENODO["publication_date"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", date)


def test_citation_and_archive_say_the_same() -> None:
    assert CITATION["title"] == ZENODO["title"]
    assert CITATION["license"] == ZENODO["license"] == "BSD-3-Clause"
    assert CITATION["keywords"] == ZENODO["keywords"]
    assert CITATION["abstract"].strip() == re.sub(r"</?p>", "", ZENODO["description"])
    assert [item["name"] for item in CITATION["authors"]] == [
        item["name"] for item in ZENODO["creators"]
    ]


def _section(name: str) -> list[str]:
    """The lines of a section of the Apptainer definition."""
    text = APPTAINER.read_text()
    (body,) = re.findall(rf"^%{name}\n((?:[ \t]+.*\n)+)", text, re.MULTILINE)
    return [line.strip() for line in body.splitlines()]


def _copied() -> dict[str, str]:
    """What the Dockerfile copies, and where to."""
    copies = re.findall(r"^COPY (.+) (\S+)$", DOCKERFILE.read_text(), re.MULTILINE)
    return {
        name: f"{place}{name}" if place.endswith("/") else place
        for names, place in copies
        for name in names.split()
    }


def test_both_recipes_make_the_same_image() -> None:
    docker = DOCKERFILE.read_text()
    assert _copied() == dict(line.split() for line in _section("files"))
    assert re.search(r"^FROM (.+)$", docker, re.MULTILINE)[1] in APPTAINER.read_text()  # type: ignore[index]
    (run,) = re.findall(r"^RUN ((?:.*\\\n)*.*)$", docker, re.MULTILINE)
    steps = [step.strip() for step in run.replace("\\\n", "").split("&&")]
    assert [step.replace("$EXTRAS", "{{ EXTRAS }}") for step in steps] == _section("post")
    assert re.search(r"^ARG (.+)$", docker, re.MULTILINE)[1] == _section("arguments")[0]  # type: ignore[index]
    assert f"ENV {_section('environment')[0].removeprefix('export ')}" in docker.splitlines()


def test_an_image_is_made_of_files_that_are_here_and_its_context_has_them() -> None:
    ignored = (ROOT / "envs" / "Dockerfile.dockerignore").read_text().split()
    assert {f"!{name}" for name in _copied()} < set(ignored)
    for name in _copied():
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize("path", [DOCKERFILE, APPTAINER], ids=lambda path: path.name)
def test_a_recipe_names_no_host(path: Path) -> None:
    assert "://" not in path.read_text()
