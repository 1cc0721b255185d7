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
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, TextIO

from puckbench.codecs.registry import module_of
from puckbench.codeversion import code_version
from puckbench.config import checked, read_schema
from puckbench.datasets.registry import REGISTRY as LOADERS
from puckbench.errors import InputError
from puckbench.figures.registry import EXAMPLES, FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.files import unreadable
from puckbench.plan import DataSetPlan, Plan
from puckbench.sensor.errors import module_of_model, open_error_model
from puckbench.sensor.sensor import load_sensor
from puckbench.sensor.sweep import open_sweep

_held: list[TextIO] = []
_BYTES_PER_POINT = 1_000
"""Generous estimate of a job's memory for each point that it handles."""


class Workflow:
    """The plan of a configuration, as the rules need it."""

    def __init__(self, config: Mapping[str, Any], schema: Path) -> None:
        self.config = checked(config, read_schema(schema))
        self.plan = Plan(self.config)
        self.figures = figures(self.config, self.plan)
        for name in self.figures:
            self._check_style(name)

    def dataset(self, name: str) -> DataSetPlan:
        """The plan of a data set."""
        return self.plan.datasets[name]

    def scene_file(self, dataset: str, cloud: str, suffix: str = "ply") -> str:
        """The scene that a cloud is made from."""
        scenes = self.dataset(dataset).scenes
        return str(self.plan.results / "scenes" / scenes / f"{cloud}.{suffix}")

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
        module = LOADERS.get(plan.loader, plan.loader).rpartition(":")[0]
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
        return shlex.join(word for pair in values.items() for word in pair)

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

    def codec_code(self, command: str, codec: str) -> str:
        """Fingerprint of a command and of one codec."""
        return code_version(command, module_of(self.plan.codecs[codec]["class"]))

    def evaluated(self, dataset: str, cloud: str) -> dict[str, str]:
        """Further inputs of the evaluation: the true surface and what the sensor saw of it."""
        if not self.dataset(dataset).has_truth:
            return {}
        visible = self.plan.results / "truth" / dataset / f"{cloud}.ply"
        return {"truth": self.scene_file(dataset, cloud), "visible": str(visible)}

    def memory_mb(self, dataset: str) -> int:
        """Estimate of a job's memory in MB: the interpreter's and libraries', and the points'."""
        return 400 + self.dataset(dataset).points * _BYTES_PER_POINT // 1_000_000

    def figure_style(self, figure: str) -> str:
        """Style of one figure, as JSON: the configured style, then the figure's own options."""
        chosen = self.config["figures"]
        titles = {
            name: plan.settings["title"]
            for name, plan in self.plan.datasets.items()
            if "title" in plan.settings
        }
        base = {"datasets": list(self.plan.datasets), "dataset_titles": titles}
        layers = [base, chosen["style"], chosen["options"].get(figure, {})]
        return json.dumps(layers, sort_keys=True)

    def _check_style(self, figure: str) -> None:
        try:
            FigureStyle.from_config(*json.loads(self.figure_style(figure)))
        except InputError as error:
            raise InputError(f"figures.style: {error}") from error

    def figure_code(self, figure: str) -> str:
        """Fingerprint of a figure's own module and of what draws all figures."""
        entry = FIGURES[figure]
        return f"{code_version('puckbench.cli.figure', entry.function.split(':')[0])} {entry}"


def figures(config: Mapping[str, Any], plan: Plan) -> dict[str, dict[str, str]]:
    """The figures that can be drawn from this configuration, with the file of each input."""
    examples = {
        f"example_{kind}": _example(cloud, plan)
        for kind, cloud in config["figures"]["examples"].items()
    }
    tables = {
        "metrics": str(plan.results / "tables" / "metrics.parquet"),
        "clouds": str(plan.results / "tables" / "clouds.parquet"),
    }
    known = {**tables, **{name: file for name, file in examples.items() if name in EXAMPLES}}
    truth = any(item.has_truth for item in plan.datasets.values())
    return {
        name: {needed: known[needed] for needed in entry.inputs}
        for name, entry in FIGURES.items()
        if known.keys() >= set(entry.inputs) and (truth or not entry.needs_truth)
    }


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


def hold_results(results: Path) -> None:
    """Keep other runs off the results folder while this process lives, however it ends.

    A lock of the operating system, which dies with its holder: a killed run leaves none behind.
    InputError when another run holds it or the folder cannot be written.
    """
    import fcntl

    try:
        results.mkdir(parents=True, exist_ok=True)
        lock = (results / ".lock").open("w")
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(f"{results}: another run is writing there") from error
    except OSError as error:
        raise unreadable(results, error, "not writable") from error
    _held.append(lock)
