from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.figures.registry import FIGURES, figure_entries, figure_entry
from puckbench.metrics.table_registry import table_entries
from puckbench.planning.config import Config, read_config, trusted
from puckbench.planning.plan import open_scenes
from puckbench.planning.workflow import Workflow

_CHAPTER_5, _CHAPTER_5_RESULTS = "config/chapter5.yaml", Path("results/chapter5")
"""Configuration that makes chapter 5 without downloads, and its results folder."""


@dataclass(frozen=True)
class Item:
    """A figure or table of the thesis; `state` is done, missing, impossible or unplanned.

    `note` is the file, the command that makes the file, or the reason why it is impossible.
    """

    title: str
    name: str
    state: str
    note: str

    def line(self) -> str:
        return f"{self.state:10}  {self.note}"


@dataclass(frozen=True)
class Reproduction:
    """A configuration file, `changes` to the configuration, and options of Snakemake."""

    path: Path
    changes: Mapping[str, Any]
    cores: int = 2

    @cached_property
    def config(self) -> Config:
        if not self.path.is_file():
            raise InputError(f"{self.path}: no such file (run this in puckbench's folder)")
        return trusted({**read_config(self.path), **self.changes})

    @cached_property
    def absent(self) -> dict[str, str]:
        """Error messages of scene sets whose data cannot be read, by name."""
        faults = {}
        for name, value in self.config.scenes.items():
            try:
                open_scenes(name, value, self.config.seed)
            except InputError as error:
                faults[name] = str(error).removeprefix(f"scenes.{name}: ")
        return faults

    @property
    def results(self) -> Path:
        return Path(self.config.results)

    def command(self, *targets: str) -> list[str]:
        """Return the Snakemake command for `targets`, which precede options of several values."""
        words = ["snakemake", *targets, "--cores", str(self.cores), "--configfile", str(self.path)]
        settings = [f"{key}={str(value).lower()}" for key, value in self.changes.items()]
        return [*words, *(["--config", *settings] if settings else [])]

    def items(self) -> list[Item]:
        """Return every figure and table of the thesis with its state."""
        tables = {n: f"Table {e.number}" for n, e in table_entries().items() if e.number}
        figures = {n: f"Figure {e.number}" for n, e in figure_entries().items() if e.number}
        return [self._item(title, name) for name, title in {**tables, **figures}.items()]

    def _item(self, title: str, name: str) -> Item:
        absent = [scenes for scenes in self._scenes_of(name) if scenes in self.absent]
        if not self.absent and name not in self._planned:
            return Item(title, name, "unplanned", "not in this configuration")
        roots = [self.results, *([_CHAPTER_5_RESULTS] if self.absent and not absent else [])]
        files = [_file(name, root) for root in roots]
        existing = [str(file) for file in files if file.exists()]
        if existing:
            return Item(title, name, "done", existing[0])
        if absent:
            needed = ", ".join(absent)
            return Item(title, name, "impossible", f"needs the data of {needed}, see below")
        source = replace(self, path=Path(_CHAPTER_5), changes={}) if self.absent else self
        return Item(title, name, "missing", shlex.join(source.command(str(files[-1]))))

    def _scenes_of(self, name: str) -> list[str]:
        inputs = figure_entry(name).inputs if name in FIGURES else ()
        datasets, examples = self.config.datasets, self.config.figures.examples.clouds_by_kind()
        kinds = [each.removeprefix("example_") for each in inputs]
        names = [examples[kind].split("/")[0] for kind in kinds if kind in examples]
        if {"metrics", "clouds"} & set(inputs):
            names = list(datasets)
        return list(dict.fromkeys(datasets[each].scenes for each in names if each in datasets))

    @cached_property
    def _planned(self) -> set[str]:
        outputs = Workflow({**read_config(self.path), **self.changes}).outputs
        return {*outputs.study_tables, *outputs.figures}


def _file(name: str, results: Path) -> Path:
    folder, suffix = ("figures", "pdf") if name in FIGURES else ("tables", "csv")
    return results / folder / f"{name}.{suffix}"
