from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import cached_property
from inspect import signature
from typing import Any, NamedTuple, get_args

from pointkit.errors import InputError, among, naming
from pointkit.geometry.cloud import CoordinateFrame
from puckbench.codecs.registry import Look, is_codec
from puckbench.figures.plot_styles import codec_rank, entry_style, looks_layer
from puckbench.figures.registry import FigureEntry, figure_entries, figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.planning.drives import Drives
from puckbench.planning.needs.registry import Options, met_needs
from puckbench.planning.plan import Plan
from puckbench.planning.report_contents import planned_contents
from puckbench.planning.study import STUDIES, Study
from puckbench.report.contents import Contents, register_user_plugins
from puckbench.tables.registry import SENSOR, TABLES, TableEntry, table_entries, table_entry

_OF_CLOUDS = {"metrics", "clouds", "scan_errors", "recovery"}
"""Tables with a row for each cloud, or for each cloud and codec."""
_GATHERED = ("metrics", "clouds", "drives", "scan_errors", "recovery")
"""Tables that join the results of jobs, which other tables and figures may read."""
_OF_CURVES = {"metrics", "recovery"}
"""Tables with rows for coded clouds only."""
Inputs = dict[str, str]
"""Path of each input of a table or figure, by the input's name."""


class Gathered(NamedTuple):
    """What a table joins.

    Parameters
    ----------
    names
        Files with rows of results, relative to the results folder.
    rows
        Rows that are known before the run: values by name of the column.
    """

    names: tuple[str, ...]
    rows: tuple[dict[str, str], ...]


class Outputs:
    """The tables, figures and report that a run makes.

    Parameters
    ----------
    plan
        The plan of the run.
    drives, study
        The drives and the sensor study (None without a study), whose results tables and figures
        show.

    Raises
    ------
    InputError
        A table or figure of the user reads a table that does not exist, or a style is invalid.
    """

    def __init__(self, plan: Plan, drives: Drives, study: Study | None) -> None:
        self.plan, self.drives, self.study, self.config = plan, drives, study, plan.config
        register_user_plugins(self.config.figures.own, self.config.tables)
        self._check_inputs()
        for name in self.figures:
            self._check_style(name)
        for name in self.tables:
            self.table_options(name)

    def _check_inputs(self) -> None:
        """Raise InputError if a user's table or figure reads a table that does not exist."""
        examples = (f"example_{kind}" for kind in type(self.config.figures.examples).model_fields)
        of_studies = (name for study in STUDIES.names() for name in STUDIES.get(study).input_names)
        known = [*dict.fromkeys([*TABLES.names(), *of_studies, *examples])]
        entries: dict[str, TableEntry | FigureEntry]
        entries = {f"table {place}": table_entry(place) for place in self.config.tables}
        entries |= {f"figure {place}": figure_entry(place) for place in self.config.figures.own}
        for what, entry in entries.items():
            for needed in entry.inputs:
                if needed not in known:
                    raise InputError(f"{what}: no table '{needed}'{among(needed, known)}")

    # ---- tables

    @cached_property
    def gathered(self) -> dict[str, Gathered]:
        """Files and rows of the tables of results and of the plan's own rows, by table name."""
        plan = self.plan
        files = {
            "clouds": tuple(f"clouds/{'/'.join(cloud)}.json" for cloud in plan.clouds),
            "metrics": plan.rows("metrics"),
            "scan_errors": tuple(f"scan_errors/{'/'.join(c)}.json" for c in plan.scanned),
            "recovery": plan.rows("recovery"),
            "drives": self.drives.rows,
        }
        rows = {"left_out": self.left_out_rows, "codecs": tuple(map(self._looks, plan.codecs))}
        tables = {name: Gathered(names, ()) for name, names in files.items()}
        tables |= {name: Gathered((), lines) for name, lines in rows.items()}
        return {name: each for name, each in tables.items() if any(each) and self._can_make(name)}

    @cached_property
    def left_out_rows(self) -> tuple[dict[str, str], ...]:
        """Rows of the table ``left_out``, with the tables and figures that lack an input.

        Each row has the columns of `Plan.left_out_rows`.
        """
        return (*self.plan.left_out_rows(), *self._without_inputs())

    def _without_inputs(self) -> Iterator[dict[str, str]]:
        lost = {name for name in TABLES.names() if not self._can_make(name)}
        kinds: dict[str, Mapping[str, TableEntry | FigureEntry]]
        kinds = {"table": table_entries(), "figure": figure_entries()}
        for kind, entries in kinds.items() if lost else ():
            for name, entry in entries.items():
                missing = [needed for needed in entry.inputs if needed in lost]
                if missing and name not in lost and self._met.keys() >= set(entry.needs):
                    lost |= {name} if kind == "table" else set()
                    reason = f"needs the table {missing[0]}, which is left out"
                    yield {"dataset": "", "scene": "", "file": f"{kind} {name}", "reason": reason}

    def _can_make(self, table: str) -> bool:
        return not self.plan.has_failed("tables", table)

    @cached_property
    def study_tables(self) -> dict[str, Inputs]:
        """Tables of the sensor study that a run makes, with the files of their inputs."""
        inputs = self._study_inputs()
        return {
            name: {needed: inputs[needed] for needed in entry.inputs}
            for name, entry in self._makeable(inputs).items()
            if entry.category == SENSOR
        }

    @cached_property
    def result_tables(self) -> dict[str, Inputs]:
        """Tables of codecs' results that a run makes, with the files of their inputs.

        A table is made if all inputs that it requires are made, and the plan meets its needs.
        """
        there = {"metrics", "clouds", "scan_errors", "drives"} & self.gathered.keys()
        there |= self.study_tables.keys()
        return {
            name: {
                needed: self._file(needed)
                for needed in (*entry.inputs, *entry.optional)
                if needed in there
            }
            for name, entry in self._makeable(there).items()
            if entry.category != SENSOR
        }

    @cached_property
    def tables(self) -> dict[str, Inputs]:
        """All tables that a run computes from other tables, with the files of their inputs."""
        return {**self.study_tables, **self.result_tables}

    def table_options(self, table: str) -> Options:
        """Return keyword arguments for the function that makes a table, besides its inputs.

        Their values come from the needs of the table (`met_needs`) and from the configuration's
        ``bd_rate``.
        """
        entry = table_entry(table)
        options = {name: value for need in entry.needs for name, value in self._met[need].items()}
        taken = signature(entry.make).parameters
        if "anchor" in taken:
            options["anchor"] = self.anchor
        chosen = self.comparison.items()
        return options | {name: value for name, value in chosen if name in taken}

    @property
    def comparison(self) -> Options:
        """The metrics of Bjontegaard deltas and the margin of their verdicts, as options."""
        chosen = self.config.bd_rate
        return {"qualities": chosen.metrics, "margin_percent": chosen.margin_percent}

    @property
    def anchor(self) -> str:
        """Name of the codec against which Bjontegaard deltas compare; empty without codecs."""
        anchor = self.plan.anchor
        if anchor not in (*self.plan.codecs, ""):
            codecs = ", ".join(self.plan.codecs)
            raise InputError(f"bd_rate.anchor: no codec '{anchor}' among {codecs}")
        return anchor

    # ---- figures

    @cached_property
    def figures(self) -> dict[str, Inputs]:
        """Figures that a run draws, with the files of their inputs.

        If one of two such figures replaces the other (`instead_of`), the other is not drawn.
        """
        entries = figure_entries().values()
        others = {entry.instead_of for entry in entries if self._met.keys() >= set(entry.needs)}
        return {name: files for name, files in self.drawable.items() if name not in others}

    @cached_property
    def drawable(self) -> dict[str, Inputs]:
        """Figures that can be drawn, with the files of their inputs.

        All inputs of such a figure are made, and the plan meets its needs.
        """
        inputs = self._cloud_inputs() | self._study_inputs()
        return {
            name: {needed: inputs[needed] for needed in entry.inputs}
            for name, entry in figure_entries().items()
            if not self.plan.has_failed("figures", name)
            and inputs.keys() >= set(entry.inputs)
            and self._met.keys() >= set(entry.needs)
            and all(entry.frame in self._frames_of(needed) for needed in entry.inputs)
        }

    def _frames_of(self, table: str) -> tuple[CoordinateFrame, ...]:
        if table not in _OF_CLOUDS:
            return get_args(CoordinateFrame)
        if table in _OF_CURVES:
            return tuple({data.frame for data in self.plan.coded})
        clouds = self.plan.scanned if table == "scan_errors" else self.plan.clouds
        return tuple({self.plan.datasets[name].frame for name, _ in clouds})

    def _shows_codecs(self, figure: str) -> bool:
        return bool({*figure_entry(figure).inputs} & {*_OF_CURVES, "drives", *self.result_tables})

    def _shows_datasets(self, figure: str) -> bool:
        return bool({*figure_entry(figure).inputs} & _OF_CLOUDS)

    def styles_shown_by(self, figure: str) -> str:
        """Return `codec_styles` if a figure shows codecs, otherwise an empty text."""
        return self.codec_styles if self._shows_codecs(figure) else ""

    @cached_property
    def codec_styles(self) -> str:
        """Digest that changes with the styles or the order of the codecs."""
        looks = [(self._looks(name), codec_rank(name)) for name in self.plan.codecs]
        return hashlib.sha256(repr(looks).encode()).hexdigest()[:16]

    def figure_style(self, figure: str) -> tuple[dict[str, Any], ...]:
        """Return the options of a figure's style as layers, each of which overrides earlier ones.

        The layers are those of data sets and codecs, of all figures, and of this figure.
        """
        options = self.config.figures.options
        of_others = [options[name] for name in self._same_picture(figure) if name in options]
        changes = self.config.figures.style, *of_others, options.get(figure, {})
        if self._shows_codecs(figure):
            return self._style(*changes)
        return (self._dataset_style(), *changes) if self._shows_datasets(figure) else changes

    def _same_picture(self, figure: str) -> list[str]:
        """Return the other names of a figure (`instead_of`)."""
        entries = figure_entries()
        numbered = [name for name, entry in entries.items() if entry.instead_of == figure]
        return [name for name in (figure_entry(figure).instead_of, *numbered) if name]

    @property
    def style(self) -> tuple[dict[str, Any], ...]:
        """The options of the style of all figures, as layers like those of `figure_style`."""
        return self._style(self.config.figures.style)

    def _style(self, *changes: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        restyled = [name for name in self.plan.codecs if self._has_changed_looks(name)]
        looks = looks_layer([self._looks(name) for name in restyled])
        return {**self._dataset_style(), **looks}, *changes

    def _has_changed_looks(self, codec: str) -> bool:
        return not is_codec(codec) or bool(
            self.config.codec(codec).keys() & {*Look._fields, "class"}
        )

    def _looks(self, codec: str) -> dict[str, str]:
        return {"codec": codec, **asdict(entry_style(codec, self.config.codec(codec)))}

    def _dataset_style(self) -> dict[str, Any]:
        entries = {name: data.settings.title for name, data in self.plan.datasets.items()}
        entries |= {name: drive.title for name, drive in self.config.drives.items()}
        titles = {name: title for name, title in entries.items() if title is not None}
        return {"datasets": tuple(entries), "dataset_titles": titles}

    @property
    def titles(self) -> FigureStyle:
        """Style with the titles of data sets and codecs, for text that is printed."""
        return FigureStyle.from_config(*self.style)

    def _check_style(self, figure: str) -> None:
        with naming("figures.style"):
            FigureStyle.from_config(*self.figure_style(figure))

    # ---- a first look

    @cached_property
    def first_codec(self) -> str:
        """Name of the first codec that codes scaled clouds; empty if there is none."""
        codecs = (name for name in self.plan.codecs if self.plan.rows("metrics", name, "scaled"))
        return next(codecs, "")

    @cached_property
    def first_figures(self) -> list[str]:
        """Names of the figures of the first look."""
        if self.plan.has_failed("first_look") or not self.first_codec:
            return []
        return [name for name in self.figures if figure_entry(name).is_first_look]

    @property
    def first_rows(self) -> tuple[str, ...]:
        """Paths of the Parquet files that the first look draws, relative to the results folder.

        Each has the measurements of one scaled cloud, coded by the first codec.
        """
        return self.plan.rows("metrics", self.first_codec, "scaled")

    @cached_property
    def first_places(self) -> dict[str, set[str]]:
        """Scene sets, data sets and codecs of the first look, by the name of the wildcard."""
        coded = {dataset for dataset, _, codec in self.plan.curves if codec == self.first_codec}
        datasets = coded.intersection(self.plan.in_frame("scaled"))
        return {
            "scene_set": {self.plan.datasets[name].scene_set for name in datasets},
            "dataset": datasets,
            "codec": {self.first_codec},
        }

    # ---- report

    @cached_property
    def report_contents(self) -> Contents:
        """Contents of the report page: tables, figures and examples, with their files."""
        tables = [*self.result_tables, *self.study_tables]
        return planned_contents(self.plan, self.figures, self.gathered, tables, self.style)

    # ---- reference results

    @property
    def reference_inputs(self) -> Inputs:
        """Files of the tables that the file of reference results contains, by table name."""
        of_clouds = ("metrics", "clouds", "scan_errors")
        names = of_clouds if "metrics" in self.gathered else ("drives",)
        return {name: self._file(name) for name in names if name in self.gathered}

    # ---- available inputs

    def _file(self, table: str, suffix: str = "parquet") -> str:
        return f"{self.plan.results}/tables/{table}.{suffix}"

    def _makeable(self, available: Iterable[str]) -> dict[str, TableEntry]:
        inputs = set(available)
        return {
            name: entry
            for name, entry in table_entries().items()
            if not entry.gathered
            and self._can_make(name)
            and inputs >= set(entry.inputs)
            and self._met.keys() >= set(entry.needs)
        }

    def _cloud_inputs(self) -> Inputs:
        examples = self.plan.examples.items()
        inputs = {f"example_{kind}": self._example(cloud) for kind, cloud in examples}
        tables = [name for name in _GATHERED if name in self.gathered]
        if tables:
            inputs |= {name: self._file(name) for name in (*tables, *self.result_tables)}
        return inputs

    def _study_inputs(self) -> Inputs:
        tables = {} if self.study is None else self.study.inputs
        return {name: self._file(table) for name, table in tables.items() if self._can_make(table)}

    @cached_property
    def _met(self) -> dict[str, Options]:
        return met_needs(self.plan)

    def _example(self, name: str) -> str:
        dataset, cloud = name.split("/")
        datasets = self.plan.datasets
        if dataset not in datasets or cloud not in datasets[dataset].clouds:
            raise InputError(f"figures.examples: no cloud '{name}' in this configuration")
        return f"{self.plan.results}/clouds/{dataset}/{cloud}.ply"
