"""The checklist of the thesis's figures and tables: what is there, what is left, what is missing.

What is there is read off files and their times, in seconds however large the configuration. That
code or parameters have changed since, only Snakemake knows.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.figures.registry import FIGURES, figure_entries, figure_entry
from puckbench.metrics.table_registry import table_entries
from puckbench.planning.config import Config, read_config, trusted
from puckbench.planning.job_times import JobKind
from puckbench.planning.outputs import Inputs
from puckbench.planning.plan import DataSetPlan, open_scenes
from puckbench.planning.workflow import Workflow

_CHAPTER_5, _CHAPTER_5_RESULTS = "config/chapter5.yaml", Path("results/chapter5")
"""A configuration that makes chapter 5 without any data, and where."""


@dataclass(frozen=True)
class Item:
    """A figure or table of the thesis. state: done, stale, missing, impossible or unplanned.

    note: its file where it is done; the command that makes it; or why there is none.
    """

    title: str
    name: str
    state: str
    note: str

    def line(self) -> str:
        """State and note, as the checklist prints them."""
        return f"{self.state:10}  {self.note}"


@dataclass(frozen=True)
class Stage:
    """Files of one kind, named below their folder without suffix: those planned, those there."""

    folder: Path
    suffix: str
    planned: frozenset[str]

    @cached_property
    def there(self) -> Mapping[str, float]:
        """Planned files that exist, and when they were written (seconds)."""
        cut = len(str(self.folder)) + 1
        found = {
            path[cut : -len(self.suffix)]: time
            for path, time in _files(self.folder)
            if path.endswith(self.suffix)
        }
        return {name: time for name, time in found.items() if name in self.planned}

    @property
    def whole(self) -> bool:
        """Whether nothing is left to make."""
        return len(self.there) == len(self.planned)


def _files(folder: Path) -> Iterator[tuple[str, float]]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except FileNotFoundError:
        return
    for entry in entries:
        if entry.is_dir():
            yield from _files(Path(entry.path))
        else:
            yield entry.path, entry.stat().st_mtime


@dataclass(frozen=True)
class Reproduction:
    """A configuration file, and how Snakemake is called for it.

    changes: top-level keys that are others than in the file (`--config` of Snakemake).
    """

    path: Path
    snakefile: Path
    changes: Mapping[str, Any]
    cores: int = 2

    @cached_property
    def config(self) -> Config:
        """The checked configuration; InputError when it cannot be read or is not valid."""
        for path in (self.path, self.snakefile):
            if not path.is_file():
                raise InputError(f"{path}: no such file (run this in puckbench's folder)")
        return trusted({**read_config(self.path), **self.changes})

    @cached_property
    def absent(self) -> dict[str, str]:
        """Scene sets whose data are not there, and what should lie where."""
        faults = {}
        for name, value in self.config.scenes.items():
            try:
                open_scenes(name, value, self.config.seed)
            except InputError as error:
                faults[name] = str(error).removeprefix(f"scenes.{name}: ")
        return faults

    @cached_property
    def bench(self) -> Workflow:
        """The plan; InputError names what does not exist."""
        return Workflow({**read_config(self.path), **self.changes})

    @property
    def results(self) -> Path:
        """Folder of everything that is made."""
        return Path(self.config.results)

    def command(self, *targets: str) -> list[str]:
        """The words of the Snakemake command that makes some targets.

        They stand before the options, of which the last two take all words that follow.
        """
        words = ["snakemake", *targets, "--cores", str(self.cores), "--configfile", str(self.path)]
        settings = [f"{key}={str(value).lower()}" for key, value in self.changes.items()]
        return [*words, *(["--config", *settings] if settings else [])]

    def items(self, pending: Collection[str] | None = None) -> list[Item]:
        """Every figure and table of the thesis with its state.

        pending: files that Snakemake would make, where it was asked; files' times otherwise.
        """
        tables = {n: f"Table {e.thesis}" for n, e in table_entries().items() if e.thesis}
        figures = {n: f"Figure {e.thesis}" for n, e in figure_entries().items() if e.thesis}
        return [self._item(title, name, pending) for name, title in {**tables, **figures}.items()]

    def _item(self, title: str, name: str, pending: Collection[str] | None) -> Item:
        if self.absent:
            return self._item_without_data(title, name)
        if name not in self._inputs:
            return Item(title, name, "unplanned", "this configuration does not ask for it")
        file = self._file(name, self.results)
        state = self._state(name, file, pending)
        done = state == "done"
        return Item(title, name, state, str(file) if done else shlex.join(self.command(str(file))))

    def _item_without_data(self, title: str, name: str) -> Item:
        """What can be said where the whole cannot be planned: files of another time or place."""
        absent = [scenes for scenes in self._scenes_of(name) if scenes in self.absent]
        own, other = (self._file(name, root) for root in (self.results, _CHAPTER_5_RESULTS))
        made = [file for file in (own, *([] if absent else [other])) if file.exists()]
        if made:
            return Item(title, name, "done", f"{made[0]} (as of its last run)")
        if absent:
            return Item(
                title, name, "impossible", f"needs the data of {', '.join(absent)}, see below"
            )
        chapter_5 = replace(self, path=Path(_CHAPTER_5), changes={})
        return Item(title, name, "missing", shlex.join(chapter_5.command(str(other))))

    def _file(self, name: str, results: Path) -> Path:
        folder, suffix = ("figures", "pdf") if name in FIGURES else ("tables", "csv")
        return results / folder / f"{name}.{suffix}"

    def _scenes_of(self, name: str) -> list[str]:
        """Scene sets that a figure is made from; none of the tables of chapter 5."""
        inputs = figure_entry(name).inputs if name in FIGURES else ()
        datasets = self.config.datasets
        chosen = self.config.figures.examples.given()
        kinds = [one.removeprefix("example_") for one in inputs]
        names = [chosen[kind].split("/")[0] for kind in kinds if kind in chosen]
        if {"metrics", "clouds"} & set(inputs):
            names = list(datasets)
        return list(dict.fromkeys(datasets[one].scenes for one in names if one in datasets))

    def _state(self, name: str, file: Path, pending: Collection[str] | None) -> str:
        if not file.exists():
            return "missing"
        if pending is not None:
            return "stale" if str(file) in pending else "done"
        inputs = self._inputs[name].values()
        fresh = all(self._fresh(Path(source), file.stat().st_mtime) for source in inputs)
        return "done" if fresh else "stale"

    @property
    def _inputs(self) -> dict[str, Inputs]:
        """Figures, and tables of the sensor study, with the files that they are made from."""
        return {**self.bench.outputs.study_tables, **self.bench.outputs.figures}

    def _fresh(self, source: Path, made: float) -> bool:
        """Whether an input is there, older than what was made of it, and itself fresh."""
        if not source.exists() or source.stat().st_mtime > made:
            return False
        stage = {"metrics": "metrics", "clouds": "about"}.get(source.stem)
        if stage is None or source.parent.name != "tables":
            return True
        rows = self.stages[stage]
        return rows.whole and max(rows.there.values(), default=0.0) <= source.stat().st_mtime

    @cached_property
    def stages(self) -> dict[str, Stage]:
        """The files of every stage of the benchmark."""
        plan, root = self.bench.plan, self.results
        curves = frozenset(map("/".join, plan.curves))
        clouds = frozenset(map("/".join, plan.clouds))
        used = {data.scenes: data.clouds for data in plan.datasets.values()}
        scenes = frozenset(f"{name}/{scene}" for name, found in used.items() for scene in found)
        return {
            "scenes": Stage(root / "scenes", ".ply", scenes),
            "samples": Stage(root / "samples", ".ply", self._made("sample")),
            "scans": Stage(root / "scans", ".parquet", self._made("scan")),
            "clouds": Stage(root / "clouds", ".ply", clouds),
            "about": Stage(root / "clouds", ".json", clouds),
            "coded": Stage(root / "coded", ".zip", curves),
            "metrics": Stage(root / "metrics", ".parquet", curves),
            "figures": Stage(root / "figures", ".pdf", frozenset(self.bench.outputs.figures)),
            "tables": Stage(root / "tables", ".csv", frozenset(self.bench.outputs.tables)),
        }

    def _made(self, how: str) -> frozenset[str]:
        sets = [d for d in self.bench.plan.datasets.values() if d.settings.make == how]
        return frozenset(f"{data.name}/{cloud}" for data in sets for cloud in data.clouds)

    def progress(self) -> dict[str, tuple[int, int]]:
        """Files that are there and files that are planned, by stage."""
        shown = {name: stage for name, stage in self.stages.items() if name != "about"}
        return {name: (len(stage.there), len(stage.planned)) for name, stage in shown.items()}

    def job_kinds(self) -> list[JobKind]:
        """The jobs of the whole configuration, alike ones together."""
        kinds = [JobKind("scene", len(self.stages["scenes"].planned))]
        for data in self.bench.plan.datasets.values():
            kinds += self._kinds_of(data)
        outputs, study = self.bench.outputs, self.bench.plan.study
        gathered = dict(outputs.gathered)
        if study is not None:
            kinds += [JobKind(job, len(study.models)) for job in ("residuals", "wall_points")]
            gathered |= self.bench.study.gathered
        kinds += [JobKind(table.job.name, 1) for table in gathered.values()]
        kinds += [JobKind("table", len(outputs.tables)), JobKind("figure", len(outputs.figures))]
        return [kind for kind in kinds if kind.jobs]

    def _kinds_of(self, data: DataSetPlan) -> list[JobKind]:
        count, points = len(data.clouds), data.points
        made = {"sample": ["sample"], "scan": ["scan"], "cloud": []}[data.settings.make]
        repeats = self.config.timing.repeats
        kinds = [JobKind(job, count, points) for job in (*made, "prepare")]
        if data.is_scanned_from_truth:
            kinds.append(JobKind("evaluate", count, points, truth=True))
        coding = self.bench.coding
        plan = self.bench.plan
        for codec in (codec for codec in plan.codecs if plan.codes(codec, data.name)):
            for curve in coding.curves:
                if (curve.codec, curve.frame) != (codec, data.frame):
                    continue
                alike = (count, points, codec, len(curve.rates), repeats)
                kinds.append(JobKind("encode_curve", *alike))
                kinds.append(JobKind("evaluate_curve", *alike, data.has_truth))
            if (data.name in plan.labelled) and codec in plan.of_surfaces:
                rates = len(plan.rates(codec, data.frame))
                kinds.append(JobKind("recovery_curve", count, points, codec, rates))
        return kinds
