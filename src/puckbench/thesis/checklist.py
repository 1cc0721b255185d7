from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.figures.registry import FIGURES, figure_entries, figure_entry
from puckbench.metrics.table_registry import table_entries
from puckbench.planning.config import Config, read_config, trusted
from puckbench.planning.outputs import Inputs
from puckbench.planning.plan import open_scenes
from puckbench.planning.stages import Stage, stages_of
from puckbench.planning.workflow import Workflow

_CHAPTER_5, _CHAPTER_5_RESULTS = "config/chapter5.yaml", Path("results/chapter5")
"""Configuration that makes chapter 5 without downloads, and its results folder."""


@dataclass(frozen=True)
class Item:
    """A figure or table of the thesis; `state` is done, stale, missing, impossible or unplanned.

    `note` is the file, the command that makes it, or the reason why none can be made.
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
    snakefile: Path
    changes: Mapping[str, Any]
    cores: int = 2

    @cached_property
    def config(self) -> Config:
        for path in (self.path, self.snakefile):
            if not path.is_file():
                raise InputError(f"{path}: no such file (run this in puckbench's folder)")
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

    @cached_property
    def bench(self) -> Workflow:
        return Workflow({**read_config(self.path), **self.changes})

    @property
    def results(self) -> Path:
        return Path(self.config.results)

    @cached_property
    def stages(self) -> dict[str, Stage]:
        return stages_of(self.bench)

    def command(self, *targets: str) -> list[str]:
        """Return the Snakemake command for `targets`; options of several values follow them."""
        words = ["snakemake", *targets, "--cores", str(self.cores), "--configfile", str(self.path)]
        settings = [f"{key}={str(value).lower()}" for key, value in self.changes.items()]
        return [*words, *(["--config", *settings] if settings else [])]

    def items(self, pending: Collection[str] | None = None) -> list[Item]:
        """Return every figure and table of the thesis with its state.

        `pending` lists the files that Snakemake would make; if None, file times decide.
        """
        tables = {n: f"Table {e.number}" for n, e in table_entries().items() if e.number}
        figures = {n: f"Figure {e.number}" for n, e in figure_entries().items() if e.number}
        return [self._item(title, name, pending) for name, title in {**tables, **figures}.items()]

    def _item(self, title: str, name: str, pending: Collection[str] | None) -> Item:
        if self.absent:
            return self._item_without_data(title, name)
        if name not in self._inputs:
            return Item(title, name, "unplanned", "not in this configuration")
        file = _file(name, self.results)
        state = self._state(name, file, pending)
        note = str(file) if state == "done" else shlex.join(self.command(str(file)))
        return Item(title, name, state, note)

    def _item_without_data(self, title: str, name: str) -> Item:
        absent = [scenes for scenes in self._scenes_of(name) if scenes in self.absent]
        file, chapter_5_file = (_file(name, root) for root in (self.results, _CHAPTER_5_RESULTS))
        files = [file] if absent else [file, chapter_5_file]
        existing = [path for path in files if path.exists()]
        if existing:
            return Item(title, name, "done", f"{existing[0]} (as of its last run)")
        if absent:
            needed = ", ".join(absent)
            return Item(title, name, "impossible", f"needs the data of {needed}, see below")
        chapter_5 = replace(self, path=Path(_CHAPTER_5), changes={})
        return Item(title, name, "missing", shlex.join(chapter_5.command(str(chapter_5_file))))

    def _scenes_of(self, name: str) -> list[str]:
        inputs = figure_entry(name).inputs if name in FIGURES else ()
        datasets, examples = self.config.datasets, self.config.figures.examples.clouds_by_kind()
        kinds = [each.removeprefix("example_") for each in inputs]
        names = [examples[kind].split("/")[0] for kind in kinds if kind in examples]
        if {"metrics", "clouds"} & set(inputs):
            names = list(datasets)
        return list(dict.fromkeys(datasets[each].scenes for each in names if each in datasets))

    def _state(self, name: str, file: Path, pending: Collection[str] | None) -> str:
        if not file.exists():
            return "missing"
        if pending is not None:
            return "stale" if str(file) in pending else "done"
        inputs = self._inputs[name].values()
        is_fresh = all(self._is_fresh(Path(path), file.stat().st_mtime) for path in inputs)
        return "done" if is_fresh else "stale"

    @property
    def _inputs(self) -> dict[str, Inputs]:
        return {**self.bench.outputs.study_tables, **self.bench.outputs.figures}

    def _is_fresh(self, path: Path, output_time: float) -> bool:
        if not path.exists() or path.stat().st_mtime > output_time:
            return False
        stage = {"metrics": "metrics", "clouds": "about"}.get(path.stem)
        if stage is None or path.parent.name != "tables":
            return True
        rows = self.stages[stage]
        newest = max(rows.existing.values(), default=0.0)
        return rows.is_complete and newest <= path.stat().st_mtime

    def progress(self) -> dict[str, tuple[int, int]]:
        return {
            name: (len(stage.existing), len(stage.planned))
            for name, stage in self.stages.items()
            if name != "about"
        }


def _file(name: str, results: Path) -> Path:
    folder, suffix = ("figures", "pdf") if name in FIGURES else ("tables", "csv")
    return results / folder / f"{name}.{suffix}"
