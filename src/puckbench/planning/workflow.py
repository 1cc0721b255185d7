from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pointkit.errors import InputError, among, closest
from puckbench.core.environment import COMMIT, source_commit
from puckbench.planning.coding_costs import CodingCosts
from puckbench.planning.config import trusted
from puckbench.planning.drives import Drives
from puckbench.planning.files import Files
from puckbench.planning.outputs import Outputs
from puckbench.planning.plan import Plan
from puckbench.planning.study import Study, study_of
from puckbench.steps.step import STEPS, PlannedStep


class Workflow:
    """A planned run, from which Snakemake's rules take their steps.

    Parameters
    ----------
    config
        The configuration, not yet checked. The user's code that it names is trusted.
    check_scenes
        Whether to read the scenes first, and to exclude those that cannot be used.

    Raises
    ------
    InputError
        The configuration is invalid, or names something that does not exist.
    """

    def __init__(self, config: Mapping[str, Any], check_scenes: bool = False) -> None:
        self.config = trusted(config)
        self.plan = Plan(self.config, check_scenes)
        self._steps: dict[tuple[str, ...], PlannedStep] = {}
        self.files = Files(self.plan)
        self.costs = CodingCosts(self.files)
        self.study = study_of(self.plan)
        self.drives = Drives(self.plan, self.costs)
        self.outputs = Outputs(self.plan, self.drives, self.study)

    @property
    def sensor_study(self) -> Study:
        """The sensor study; raises InputError if the run has none."""
        if self.study is None:
            raise InputError("the configuration has no sensor study")
        return self.study

    def step(self, rule: str, **wildcards: str) -> PlannedStep:
        """Return the step of a rule, as it is planned for values of the rule's wildcards.

        Raises
        ------
        InputError
            The plan has no such result.
        """
        key = rule, *wildcards.values()
        if key not in self._steps:
            self.check_names(wildcards)
            self._steps[key] = STEPS.get(rule).of_plan(self, **wildcards)
        return self._steps[key]

    def check_names(self, names: Mapping[str, str]) -> None:
        """Raise InputError if a result is requested that the configuration does not define.

        Parameters
        ----------
        names
            Values of the wildcards in the path of a requested result, such as ``dataset``,
            ``cloud``, ``codec`` and ``rate``.
        """
        if "cloud" in names:
            self._check_cloud(**names)
        elif "drive" in names:
            self._check_drive(**names)
        elif "scene" in names:
            self._check_scene(**names)

    def _check_cloud(
        self, dataset: str, cloud: str, codec: str | None = None, rate: str | None = None
    ) -> None:
        data = self.plan.datasets[dataset]
        left_out = self.plan.left_out.get(dataset, {})  # whose jobs tell what is wrong with them
        if cloud not in data.sources and not {cloud, cloud.rpartition("-")[0]} & left_out.keys():
            raise InputError(
                f"data set {dataset} has no cloud '{cloud}'{closest(cloud, list(data.clouds))}"
            )
        if codec is not None and not self.plan.codes(codec, dataset):
            raise InputError(f"codec {codec} does not code the data set {dataset}")
        rates = () if codec is None else self.plan.rates(codec, data.frame)
        if rate is not None and rate not in rates:
            raise InputError(f"codec {codec} has no rate '{rate}'{among(rate, rates)}")

    def _check_drive(self, drives: str, drive: str, codec: str | None = None) -> None:
        entry = self.drives.entries[drives]
        if drive not in entry.drives:
            raise InputError(f"{drives} has no drive '{drive}'{closest(drive, list(entry.drives))}")
        if codec is not None and codec not in entry.rates:
            raise InputError(f"codec {codec} does not code {drives}")

    def _check_scene(self, scene_set: str, scene: str) -> None:
        names = self.plan.scene_sets[scene_set].names
        if scene not in names:
            raise InputError(f"{scene_set} has no scene '{scene}'{closest(scene, list(names))}")


def run_jobs_with(source: str) -> None:
    """Change environment variables, so that jobs run with this Python and with these sources.

    Parameters
    ----------
    source
        Folder that is put first in ``PYTHONPATH``.
    """
    for name, first in (("PATH", str(Path(sys.executable).parent)), ("PYTHONPATH", source)):
        paths = [first, *os.environ.get(name, "").split(os.pathsep)]
        os.environ[name] = os.pathsep.join(dict.fromkeys(filter(None, paths)))
    os.environ.pop(COMMIT, None)
    os.environ[COMMIT] = source_commit()
