"""What the Snakefile asks: the parameters, inputs and resources of each job, from the plan.

An artefact is re-made when its parameters change, and the fingerprint of the code that makes it is
one of them: see `codeversion`.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from puckbench.codecs.registry import module_of, training_class
from puckbench.core.environment import thread_environment
from puckbench.core.errors import InputError
from puckbench.core.files import sha256
from puckbench.datasets.registry import LOADERS
from puckbench.figures.registry import BOTH_GPCC, FIGURES, FigureEntry, at, figure_entries
from puckbench.figures.style import FigureStyle
from puckbench.geometry.scaling import GRID
from puckbench.lidar.errors import module_of_model, open_error_model
from puckbench.lidar.residual_table import REAL
from puckbench.lidar.sensor import load_sensor
from puckbench.lidar.sweep import open_sweep
from puckbench.metrics.registry import (
    SENSOR,
    SEVERAL_CODECS,
    STUDY,
    TABLES,
    TableEntry,
    table_entries,
)
from puckbench.planning.config import checked, read_schema
from puckbench.planning.fingerprints import code_version
from puckbench.planning.plan import DataSetPlan, Plan, StudyPlan, TrainingPlan
from puckbench.planning.report_contents import planned_contents
from puckbench.report.contents import Contents
from puckbench.report.page import assets_version
from puckbench.thesis.claims.roles import GPCC, GPCC_AS_RUN, codec_roles, verdict_options

WALL_POINTS = 40_000
"""Points of a surface at a distance that the study's figures of scans are drawn from."""
_BYTES_PER_POINT = 1_000
"""Generous estimate of a job's memory for each point that it handles."""
_BYTES_PER_PIXEL = 100
"""Of the six pictures' width times height, one at a time: 305 MB were measured at 1920 pixels."""
_BYTES_PER_TRAINING_POINT = 50
"""Of a training, which keeps nothing of a point but its coordinates."""


class Workflow:
    """The plan of a configuration, as the rules need it."""

    def __init__(self, config: Mapping[str, Any], schema: Path) -> None:
        self.config = checked(config, read_schema(schema))
        self.plan = Plan(self.config)
        self.results = str(self.plan.results)
        self.figures = figures(self.config, self.plan)
        for name in self.figures:
            self._check_style(name)
        for name in self.result_tables():
            self.table_options(name)

    def dataset(self, name: str) -> DataSetPlan:
        """The plan of a data set."""
        return self.plan.datasets[name]

    def scene_file(self, dataset: str, cloud: str, suffix: str = "ply") -> str:
        """The scene that a cloud is made from."""
        scenes = self.dataset(dataset).scenes
        return f"{self.results}/scenes/{scenes}/{cloud}.{suffix}"

    def source(self, dataset: str, cloud: str) -> str:
        """What a cloud is prepared from: a sample, a scan, or the scene's own cloud."""
        make = self.dataset(dataset).settings["make"]
        if make == "cloud":
            return self.scene_file(dataset, cloud)
        folder, suffix = {"sample": ("samples", "ply"), "scan": ("scans", "parquet")}[make]
        return str(self.plan.results / folder / dataset / f"{cloud}.{suffix}")

    @cache  # noqa: B019 (one workflow lives as long as the process)
    def scene_parameters(self, scenes: str) -> dict[str, str]:
        """Loader, its options and the code of a scene set."""
        plan = self.plan.scenes[scenes]
        module = LOADERS.module_of(plan.loader)
        return {
            "loader": plan.loader,
            "options": json.dumps(plan.options, sort_keys=True),
            "seed": str(plan.seed),
            "code": code_version("puckbench.cli.scene", module),
        }

    def scan_arguments(self, dataset: str) -> str:
        """Arguments of `puckbench scan` for a data set, quoted for a shell."""
        plan = self.dataset(dataset)
        sweep = plan.settings["sweep"]
        values = {
            "--sensor": plan.settings["sensor"],
            "--errors": plan.settings["errors"],
            "--error-options": json.dumps(plan.settings["error_options"], sort_keys=True),
            "--sweep": sweep if isinstance(sweep, str) else json.dumps(sweep, sort_keys=True),
            "--height": str(plan.settings["height_m"]),
            "--seed": str(plan.seed),
        }
        anywhere = ["--anywhere"] if plan.settings["anywhere"] else []
        return shlex.join([*(word for pair in values.items() for word in pair), *anywhere])

    def scan_code(self, dataset: str) -> str:
        """Fingerprint of the scanner, its sensor, its error model and its trajectory's file."""
        settings = self.dataset(dataset).settings
        model = open_error_model(settings["errors"], settings["error_options"])
        code = code_version("puckbench.cli.scan", module_of_model(model))
        sweep = hashlib.sha256(repr(open_sweep(settings["sweep"])).encode()).hexdigest()[:16]
        return f"{code} {model} {load_sensor(settings['sensor'])} {sweep}"

    def crop_arguments(self, dataset: str, cloud: str) -> str:
        """Arguments of `puckbench prepare` that crop a scan to its room's box."""
        settings = self.dataset(dataset).settings
        if settings["make"] != "scan" or settings["crop"] == "none":
            return ""
        return f"--crop {self.scene_file(dataset, cloud, 'json')} --crop-on {settings['crop']}"

    def codec_entry(self, codec: str, rate: str) -> str:
        """The codec's entry with that rate alone, as JSON."""
        entry = self.plan.codecs[codec]
        return json.dumps({**entry, "rates": {rate: entry["rates"][rate]}}, sort_keys=True)

    @cache  # noqa: B019 (one workflow lives as long as the process)
    def codec_code(self, command: str, codec: str) -> str:
        """Fingerprint of a command, of one codec, and of its weights where it has any."""
        code = code_version(command, module_of(self.plan.codecs[codec]["class"]))
        return " ".join([code, *map(sha256, self.plan.weights[codec])])

    def training(self, name: str) -> TrainingPlan:
        """The plan of a training."""
        return self.plan.trainings[name]

    def cloud_files(self, clouds: Iterable[tuple[str, str]]) -> list[str]:
        """Prepared clouds of (data set, cloud)."""
        folder = self.plan.results / "clouds"
        return [str(folder / dataset / f"{cloud}.ply") for dataset, cloud in clouds]

    def training_arguments(self, name: str) -> str:
        """Arguments of `puckbench train` for a training, quoted for a shell."""
        plan = self.training(name)
        values = {
            "--codec": plan.codec,
            "--entry": json.dumps(plan.entry, sort_keys=True),
            "--options": json.dumps(plan.settings, sort_keys=True),
            "--validate-every": str(plan.validate_every),
            "--code": self.training_code(name),
        }
        return shlex.join(word for pair in values.items() for word in pair)

    def training_code(self, name: str) -> str:
        """Fingerprint of what a training learns with: one begun with other code is begun anew."""
        plan = self.training(name)
        return code_version(module_of(training_class(plan.codec, plan.entry)))

    def training_memory_mb(self, name: str) -> int:
        """Estimate of a training's memory in MB: the network's, and that of all clouds at once."""
        points = sum(self.dataset(dataset).points for dataset, _ in self.training(name).clouds)
        return 3000 + points * _BYTES_PER_TRAINING_POINT // 1_000_000

    def evaluated(self, dataset: str, cloud: str) -> dict[str, str]:
        """Further inputs of the evaluation: the true surface and what the sensor saw of it."""
        if not self.dataset(dataset).has_truth:
            return {}
        seen = "clean" if self.dataset(dataset).is_scanned_from_truth else "visible"
        return {"truth": self.scene_file(dataset, cloud), seen: self.true_points(dataset, cloud)}

    def true_points(self, dataset: str, cloud: str) -> str:
        """The points of the true surface that a cloud's own stand for, labelled as the scene is."""
        return f"{self.results}/truth/{dataset}/{cloud}.ply"

    def row_tables(self) -> dict[str, list[str]]:
        """The tables that are made of result rows of their own, with the files of these rows."""
        parts = {"scan_errors": self.plan.scanned, "recovery": self.plan.recovered}
        return {
            name: [str(self.plan.results / name / f"{'/'.join(part)}.json") for part in rows]
            for name, rows in parts.items()
            if rows
        }

    @cache  # noqa: B019
    def encode_arguments(self, codec: str, rate: str) -> str:
        """Arguments of `puckbench encode` for a codec and rate, quoted for a shell."""
        words = ["--codec", codec, "--rate", rate, "--entry", self.codec_entry(codec, rate)]
        return shlex.join([*words, *self._timing_arguments()])

    def evaluate_arguments(self, dataset: str, cloud: str, codec: str, rate: str) -> str:
        """Arguments of `puckbench evaluate` for a cell, quoted for a shell."""
        truth = self.evaluated(dataset, cloud)
        files = [f"--{name} {file}" for name, file in truth.items()]
        return " ".join([self._measured_arguments(dataset, codec, rate), *files])

    @cache  # noqa: B019
    def _measured_arguments(self, dataset: str, codec: str, rate: str) -> str:
        settings = self.dataset(dataset).settings
        words = ["--dataset", dataset, "--codec", codec, "--entry", self.codec_entry(codec, rate)]
        if settings["size"] != GRID:
            words += ["--peak", str(settings["size"] - 1)]
        words += ["--views", str(settings["views"]), *self._timing_arguments()]
        return shlex.join(words)

    def _timing_arguments(self) -> list[str]:
        timing = self.config["timing"]
        alone = ["--alone"] if timing["exclusive"] else []
        return ["--repeats", str(timing["repeats"]), *alone]

    @property
    def timed(self) -> str:
        """What goes before the command of a timed job: the threads that libraries may use."""
        return thread_environment(self.config["timing"]["threads"])

    def timed_cores(self, cores: int | None) -> int:
        """Cores that a timed job takes of those of the run: all where it is to run alone.

        cores: of the run; None where a cluster's nodes, not this machine, run the jobs.
        """
        timing = self.config["timing"]
        threads = int(timing["threads"])
        return max(threads, cores or 0) if timing["exclusive"] else threads

    def memory_mb(self, dataset: str) -> int:
        """Estimate of a job's memory in MB: the interpreter's and libraries', and the points'."""
        return 400 + self.dataset(dataset).points * _BYTES_PER_POINT // 1_000_000

    @property
    def cell_memory_mb(self) -> int:
        """The same of a job for one cloud, codec and rate, whatever the cloud, and its pictures.

        One number for all, since a function for each of very many jobs would cost planning more.
        """
        views = max((data.settings["views"] for data in self.plan.datasets.values()), default=0)
        points = max(map(self.memory_mb, self.plan.datasets), default=0)
        return points + int(views) ** 2 * _BYTES_PER_PIXEL // 1_000_000

    @property
    def study(self) -> StudyPlan:
        """The plan of the sensor study; only rules of a configuration that has one ask for it."""
        assert self.plan.study is not None  # noqa: S101
        return self.plan.study

    def residual_files(self) -> list[tuple[str, str]]:
        """Name and residual table of every model and capture; all captures have one name."""
        folder = self.plan.results / "residuals"
        models = [(name, str(folder / "models" / f"{name}.parquet")) for name in self.study.models]
        return models + [(REAL, file) for file in self.capture_files()]

    def capture_files(self) -> list[str]:
        """Residual tables of the study's captures."""
        folder = self.plan.results / "residuals" / "captures"
        return [str(folder / f"{name}.parquet") for name in self.study.captures]

    def residual_arguments(self, model: str) -> str:
        """Arguments of `puckbench residuals` for a model of the study, quoted for a shell."""
        study = self.study
        values = ["--distances", *map(_number, study.all_distances_m), "--runs", str(study.runs)]
        values += ["--keep", str(study.rows), *(["--refit"] if study.refit else [])]
        return shlex.join([*self._model_arguments(model), *values])

    def wall_arguments(self, model: str) -> str:
        """Arguments of `puckbench wall` for a model of the study, quoted for a shell."""
        distances = ["--distances", *map(_number, self.study.shown_m)]
        keep = ["--keep", str(WALL_POINTS)]
        return shlex.join([*self._model_arguments(model), *distances, *keep])

    def _model_arguments(self, model: str) -> list[str]:
        errors, options = self.study.models[model]
        given = json.dumps(options, sort_keys=True)
        return ["--model", errors, "--model-options", given, "--seed", str(self.study.seed)]

    def model_code(self, module: str, model: str) -> str:
        """Fingerprint of a measurement of the study, of its error model and of the sensor."""
        opened = open_error_model(*self.study.models[model])
        code = code_version(module, module_of_model(opened))
        return f"{code} {opened} {load_sensor('vlp16')}"

    def study_tables(self) -> dict[str, dict[str, str]]:
        """The tables of the study that can be made, with the file of each input."""
        known = _study_inputs(self.plan)
        return {
            name: {needed: known[needed] for needed in entry.inputs}
            for name, entry in _makeable(self.plan, known).items()
            if entry.category == SENSOR
        }

    def result_tables(self) -> dict[str, dict[str, str]]:
        """The tables of the benchmark that can be made, with the file of each input."""
        there = {"metrics", "clouds"} if self.plan.datasets else set()
        there |= set(self.study_tables())
        return {
            name: {
                needed: _table(self.plan, needed)
                for needed in (*entry.inputs, *entry.optional)
                if needed in there
            }
            for name, entry in _makeable(self.plan, there).items()
            if entry.category != SENSOR
        }

    def table_options(self, table: str) -> str:
        """Options of `puckbench table` for a table of the benchmark, as JSON."""
        verdicts = verdict_options(self.plan)
        if table in verdicts:
            return json.dumps(verdicts[table], sort_keys=True)
        if not _of_rate_deltas(table):
            return "{}"
        chosen = self.config["bd_rate"]
        options = {"anchor": self.anchor, "qualities": chosen["metrics"]}
        if table == "bd_rate":
            options |= {"resamples": chosen["resamples"], "seed": self.config["seed"]}
        return json.dumps(options, sort_keys=True)

    @property
    def anchor(self) -> str:
        """The codec that the others are compared with: the configured one, else the first."""
        anchor = str(self.config["bd_rate"].get("anchor", next(iter(self.plan.codecs))))
        if anchor not in self.plan.codecs:
            known = ", ".join(self.plan.codecs)
            raise InputError(f"bd_rate.anchor: no codec '{anchor}' among {known}")
        return anchor

    def table_code(self, table: str) -> str:
        """Fingerprint of a table's own module and of what writes all of them."""
        return code_version("puckbench.jobs.table", TABLES.module_of(table))

    def figure_style(self, figure: str) -> str:
        """Style of one figure, as JSON: the configured style, then the figure's own options."""
        chosen = self.config["figures"]
        return self._style(chosen["style"], chosen["options"].get(figure, {}))

    def _style(self, *changes: Mapping[str, Any]) -> str:
        titles = {
            name: plan.settings["title"]
            for name, plan in self.plan.datasets.items()
            if "title" in plan.settings
        }
        base = {"datasets": list(self.plan.datasets), "dataset_titles": titles}
        return json.dumps([base, *changes], sort_keys=True)

    def _check_style(self, figure: str) -> None:
        try:
            FigureStyle.from_config(*json.loads(self.figure_style(figure)))
        except InputError as error:
            raise InputError(f"figures.style: {error}") from error

    def figure_code(self, figure: str) -> str:
        """Fingerprint of a figure's own module and of what draws all figures."""
        return code_version("puckbench.figures.drawing", FIGURES.module_of(figure))

    def report(self) -> Contents:
        """What the report page shows."""
        tables = [*self.result_tables(), *self.study_tables()]
        layers = json.loads(self._style(self.config["figures"]["style"]))
        return planned_contents(self.plan, self.figures, tables, layers)

    def report_code(self) -> str:
        """Fingerprint of what makes the report page: modules, templates, style, scripts, texts."""
        shown: dict[str, FigureEntry | TableEntry] = {**figure_entries(), **table_entries()}
        texts = "".join(f"{one.thesis} {one.title} {one.caption}" for one in shown.values())
        digest = hashlib.sha256(texts.encode()).hexdigest()[:16]
        return f"{code_version('puckbench.report.build')} {assets_version()} {digest}"


def figures(config: Mapping[str, Any], plan: Plan) -> dict[str, dict[str, str]]:
    """The figures that can be drawn from this configuration, with the file of each input."""
    known = _cloud_inputs(config, plan) | _study_inputs(plan)
    there = _there(plan)
    return {
        name: {needed: known[needed] for needed in entry.inputs}
        for name, entry in figure_entries().items()
        if known.keys() >= set(entry.inputs) and there >= set(entry.needs)
    }


def _makeable(plan: Plan, known: Iterable[str]) -> dict[str, TableEntry]:
    """The tables without a rule of their own whose inputs and needs a plan has."""
    inputs, there = set(known), _there(plan)
    return {
        name: entry
        for name, entry in table_entries().items()
        if not entry.rule and inputs >= set(entry.inputs) and there >= set(entry.needs)
    }


def _cloud_inputs(config: Mapping[str, Any], plan: Plan) -> dict[str, str]:
    """Files of what chapter 6's figures are drawn from."""
    known = {
        f"example_{kind}": _example(cloud, plan)
        for kind, cloud in config["figures"]["examples"].items()
    }
    if plan.datasets:
        verdicts = verdict_options(plan).keys() - {"claims"}
        known |= {name: _table(plan, name) for name in ("metrics", "clouds", *verdicts)}
    if plan.scanned:
        known["scan_errors"] = _table(plan, "scan_errors")
    if plan.recovered:
        known["recovery"] = _table(plan, "recovery")
    return known


def _study_inputs(plan: Plan) -> dict[str, str]:
    """Files of what chapter 5's figures and tables are made from."""
    if plan.study is None:
        return {}
    known = {"residuals": _table(plan, "residuals")}
    if plan.study.shown_m:
        known["scans"] = _table(plan, "scans")
    if plan.study.captures:
        known |= {name: _table(plan, name) for name in ("compared_residuals", "model_distances")}
        known["compared"] = known["compared_residuals"]
    return known


def _there(plan: Plan) -> set[str]:
    """What a configuration has of that which figures and tables may need."""
    there = set(verdict_options(plan))
    if codec_roles(plan).keys() >= {GPCC, GPCC_AS_RUN}:
        there.add(BOTH_GPCC)
    if len(plan.codecs) > 1:
        there.add(SEVERAL_CODECS)
    if plan.study is None:
        return there
    return there | {STUDY, *map(at, plan.study.all_distances_m), *plan.study.models}


def _of_rate_deltas(table: str) -> bool:
    return table.startswith("bd_rate")


def _table(plan: Plan, name: str) -> str:
    return str(plan.results / "tables" / f"{name}.parquet")


def _number(value: float) -> str:
    return f"{value:g}"


def _example(name: str, plan: Plan) -> str:
    dataset, cloud = name.split("/")
    if dataset not in plan.datasets or cloud not in plan.datasets[dataset].clouds:
        raise InputError(f"figures.examples: no cloud '{name}' in this configuration")
    return str(plan.results / "clouds" / dataset / f"{cloud}.ply")


def run_jobs_with(source: str) -> None:
    """Let jobs find this Python first (a conda environment comes before it) and our `source`."""
    for name, first in (("PATH", str(Path(sys.executable).parent)), ("PYTHONPATH", source)):
        paths = [first, *os.environ.get(name, "").split(os.pathsep)]
        os.environ[name] = os.pathsep.join(dict.fromkeys(filter(None, paths)))
