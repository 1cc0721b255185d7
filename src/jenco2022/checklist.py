from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from jenco2022.needs import LOADERS
from pointkit.errors import InputError
from puckbench.figures.registry import FIGURES, figure_entries, figure_entry
from puckbench.planning.config import Config, DataSetConfig, read_config, trusted
from puckbench.planning.plan import open_scenes
from puckbench.planning.workflow import Workflow
from puckbench.tables.registry import table_entries

_CHAPTER_5, _CHAPTER_5_RESULTS = "config/chapter5.yaml", Path("results/chapter5")
"""Configuration that makes chapter 5 without downloads, and its folder of results."""
_OF_CAPTURES = frozenset(f"fig_5_{number}" for number in (*range(2, 16), 18, 20))
"""Figures that show captures of a real VLP-16 in the thesis."""
UNPUBLISHED = "its captures of a real VLP-16, in chapter 5, are unpublished"
_REPEATED = {"2.1": "fig_6_1", "2.2": "fig_6_2"}
"""Figures that show the same as a later figure, and the name of the later figure."""
_WITHOUT_DATA = {
    "4.1": "photograph of the sensor",
    "4.2": "drawing of the lasers, whose elevations Table 4.2 lists",
    "4.3": "screenshot of a scan in Blender",
    "4.4": "screenshot of BlenSor's settings",
}


@dataclass(frozen=True)
class Item:
    """A figure or table of the thesis, with the state of its reproduction.

    Parameters
    ----------
    title
        Title with the number, such as "Figure 5.10".
    name
        Name of puckbench's figure or table, or empty.
    state
        "done", "stand-in" (made of other data than the thesis's), "missing", "impossible",
        "unplanned" or "no data".
    note
        The file, the command that makes the file, or the reason why there is none.
    stand_ins
        Names of the data that replace those of the thesis, or empty.
    """

    title: str
    name: str
    state: str
    note: str
    stand_ins: str = ""

    def line(self) -> str:
        """Return state, note and stand-ins as one line of text."""
        remark = f"  # of {self.stand_ins}" if self.stand_ins else ""
        return f"{self.state:10}  {self.note}{remark}"


@dataclass(frozen=True)
class Reproduction:
    """The thesis's figures and tables that a configuration makes.

    Parameters
    ----------
    path
        Configuration file.
    changes
        Changes to the configuration.
    cores
        Number of cores in the printed commands.
    """

    path: Path
    changes: Mapping[str, Any]
    cores: int = 2

    @cached_property
    def config(self) -> Config:
        """The configuration with the changes."""
        if not self.path.is_file():
            raise InputError(f"{self.path}: no such file (run this in puckbench's folder)")
        return trusted({**read_config(self.path), **self.changes})

    @cached_property
    def absent(self) -> dict[str, str]:
        """Error messages of the scene sets whose data cannot be read, by name of the scene set."""
        faults = {}
        for name, value in self.config.scene_sets.items():
            try:
                open_scenes(name, value, self.config.seed)
            except InputError as error:
                faults[name] = str(error).removeprefix(f"scene_sets.{name}: ")
        return faults

    @property
    def results(self) -> Path:
        """Folder of the results."""
        return Path(self.config.results)

    def command(self, *targets: str) -> list[str]:
        """Return the words of the Snakemake command that makes the files `targets`."""
        words = ["snakemake", *targets, "--cores", str(self.cores), "--configfile", str(self.path)]
        settings = [f"{key}={str(value).lower()}" for key, value in self.changes.items()]
        return [*words, *(["--config", *settings] if settings else [])]

    def items(self) -> list[Item]:
        """Return every figure and table of the thesis, with its state."""
        tables = {f"Table {e.number}": n for n, e in table_entries().items() if e.number}
        figures = {f"Figure {e.number}": n for n, e in figure_entries().items() if e.number}
        repeated = {f"Figure {number}": name for number, name in _REPEATED.items()}
        without = [Item(f"Figure {n}", "", "no data", why) for n, why in _WITHOUT_DATA.items()]
        before = [self._item(title, name) for title, name in {**tables, **repeated}.items()]
        return before + without + [self._item(title, name) for title, name in figures.items()]

    def _item(self, title: str, name: str) -> Item:
        scene_sets = dict.fromkeys(data.scene_set for data in self._datasets_of(name))
        absent = [each for each in scene_sets if each in self.absent]
        stand_ins = self._stand_ins(name)
        if not self.absent and name not in self._planned:
            return Item(title, name, "unplanned", "not in this configuration")
        roots = [self.results, *([_CHAPTER_5_RESULTS] if self.absent and not absent else [])]
        files = [_file(name, root) for root in roots]
        existing = [str(file) for file in files if file.exists()]
        if existing:
            return Item(title, name, "stand-in" if stand_ins else "done", existing[0], stand_ins)
        if absent:
            needed = ", ".join(absent)
            return Item(title, name, "impossible", f"needs the data of {needed}, see below")
        source = replace(self, path=Path(_CHAPTER_5), changes={}) if self.absent else self
        command = shlex.join(source.command(str(files[-1])))
        return Item(title, name, "missing", command, stand_ins)

    def _datasets_of(self, name: str) -> list[DataSetConfig]:
        """Return the data sets that a figure shows; tables and figures of the sensor show none."""
        inputs = figure_entry(name).inputs if name in FIGURES else ()
        datasets, examples = self.config.datasets, self.config.figures.examples.clouds_by_kind()
        kinds = [each.removeprefix("example_") for each in inputs]
        names = [examples[kind].split("/")[0] for kind in kinds if kind in examples]
        if {"metrics", "clouds"} & set(inputs):
            names = [each for each, data in datasets.items() if not data.is_metric]
        return [datasets[each] for each in dict.fromkeys(names) if each in datasets]

    def _stand_ins(self, name: str) -> str:
        scene_sets = self.config.scene_sets
        loaders = dict.fromkeys(
            scene_sets[data.scene_set].loader for data in self._datasets_of(name)
        )
        others = [loader for loader in loaders if loader not in LOADERS]
        if name in _OF_CAPTURES and not self._shows_captures(name):
            others.append("virtual scans")
        return ", ".join(others)

    def _shows_captures(self, name: str) -> bool:
        study = self.config.sensor_study
        return bool(study and study.captures) and "residuals" in figure_entry(name).inputs

    @cached_property
    def _planned(self) -> set[str]:
        outputs = Workflow({**read_config(self.path), **self.changes}).outputs
        return {*outputs.study_tables, *outputs.figures}


def _file(name: str, results: Path) -> Path:
    folder, suffix = ("figures", "pdf") if name in FIGURES else ("tables", "csv")
    return results / folder / f"{name}.{suffix}"
