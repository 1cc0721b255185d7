"""Snakemake reads configuration files by itself: what it would read wrongly is refused."""

from __future__ import annotations

import re

import pytest

from tests.support.bench import Bench


def dry_run(bench: Bench, *words: str) -> tuple[int, list[str]]:
    """Status of a dry run, and what puckbench says in it."""
    done = bench.snakemake("--dry-run", "--quiet", "all", *words)
    return done.returncode, [
        line for line in done.stderr.splitlines() if line.startswith("puckbench: ")
    ]


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ("results: other\nresults: another\n", "line 2: the key 'results' is repeated"),
        ("seed: 03000\n", "line 1: seed: 03000 is 1536 in YAML 1.1, which Snakemake reads"),
    ],
)
def test_a_file_read_in_two_ways_ends_in_one_line(fresh: Bench, lines: str, fault: str) -> None:
    (fresh.folder / "more.yaml").write_text(lines)
    status, said = dry_run(fresh, "--configfile", "config.yaml", "more.yaml")
    assert status == 2
    assert len(said) == 1
    assert said[0].startswith(f"puckbench: {fresh.folder / 'more.yaml'}: {fault}")


def _with_old_keys(bench: Bench) -> None:
    config = bench.folder / "config.yaml"
    text = re.sub(r"^scene_sets:", "scenes:", config.read_text(), flags=re.MULTILINE)
    config.write_text(text.replace("scene_set: ", "scenes: "))


def test_old_keys_are_read_and_told_in_one_line(fresh: Bench) -> None:
    _with_old_keys(fresh)
    status, said = dry_run(fresh)
    assert status == 0
    assert said == [
        "puckbench: configuration: 'scenes' is now 'scene_sets'; "
        "'scenes' of a data set or drive is now 'scene_set'"
    ]


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ("scene_sets: {}\n", "the configuration has 'scenes' and 'scene_sets'"),
        (
            "datasets: {raw: {scenes: rooms, scene_set: rooms}}\n",
            "datasets.raw has 'scenes' and 'scene_set'",
        ),
    ],
)
def test_an_old_key_beside_the_new_one_ends_in_one_line(
    fresh: Bench, lines: str, fault: str
) -> None:
    (fresh.folder / "more.yaml").write_text(f"scenes: {{}}\n{lines}")
    status, said = dry_run(fresh, "--configfile", "config.yaml", "more.yaml")
    assert status == 2
    file = fresh.folder / "more.yaml"
    assert said == [f"puckbench: {file}: {fault}, which is its new name: keep one"]


def test_layers_of_files_and_values_of_the_command_line_hold(fresh: Bench) -> None:
    (fresh.folder / "more.yaml").write_text("seed: 3\nresults: layered\n")
    words = ("--configfile", "config.yaml", "more.yaml", "--config")
    status, said = dry_run(fresh, *words, "results=last")
    assert (status, said) == (0, [])
    done = fresh.snakemake("--summary", *words, "results=last")
    assert "last/coded" in done.stdout + done.stderr
    assert "layered/" not in done.stdout + done.stderr
