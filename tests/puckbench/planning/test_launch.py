"""The command of a run without what failed."""

from __future__ import annotations

from pathlib import Path

import pytest

from puckbench.planning.launch import command_for_the_rest

START = Path("/runs")
FILES = [Path("/runs/a.yaml"), Path("/runs/results/failed.yaml")]
CONFIGS = "--configfile a.yaml results/failed.yaml"


@pytest.mark.parametrize(
    ("words", "command"),
    [
        ([], f"snakemake {CONFIGS}"),
        (["tables", "--configfile", "a.yaml"], f"snakemake tables {CONFIGS}"),
        (["--configfiles", "a.yaml", "b.yaml", "-c", "2"], f"snakemake -c 2 {CONFIGS}"),
        (["--configfile=a.yaml", "--", "tables"], f"snakemake {CONFIGS} -- tables"),
        (
            ["--config", "seed=3", "results=a b", "--snakefile", "S"],
            f"snakemake --config seed=3 'results=a b' --snakefile S {CONFIGS}",
        ),
        (["--config", "seed=3", "-k"], f"snakemake --config seed=3 -k {CONFIGS}"),
    ],
)
def test_it_has_all_words_of_the_run(words: list[str], command: str) -> None:
    assert command_for_the_rest(words, FILES, START) == command


def test_it_has_whole_paths_if_another_folder_was_asked_for() -> None:
    files = [*FILES, FILES[1]]  # a second failure
    command = command_for_the_rest(["--directory", "d"], files, None)
    configs = "--configfile /runs/a.yaml /runs/results/failed.yaml"
    assert command == f"snakemake --directory d {configs}"
    assert command_for_the_rest([], [Path("/other/b.yaml")], START).endswith(" /other/b.yaml")
