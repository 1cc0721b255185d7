"""What the rules of the workflow take from their steps."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from pointkit.errors import InputError
from pointkit.files import refusing_paths, write_bytes
from puckbench.planning.provenance import Provenance
from puckbench.planning.running import SNAKEMAKE_FOLDER
from puckbench.planning.workflow import Workflow
from puckbench.steps.step import PlannedStep

P = ParamSpec("P")
T = TypeVar("T")

_LONGEST = 60_000
"""Largest number of characters of settings in a command, of which Linux takes 128 KiB."""


def or_stop(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a function; on bad input, print one line and exit with status 2."""
    try:
        with refusing_paths():
            return function(*args, **kwargs)
    except InputError as error:
        print(f"puckbench: {error}", file=sys.stderr, flush=True)  # noqa: T201
        os._exit(2)  # Snakemake would turn an exception into status 1 and a traceback


class Rules:
    """Hands out, for each rule, what it takes from its step.

    Parameters
    ----------
    flow
        The planned run.
    provenance
        Tells how present results were made; None if only Snakemake knows.
    ancient, local
        Snakemake's functions of these names. The first makes the times of inputs not count, and the
        second says that they are not in remote storage.
    has_begun
        Whether the run has begun, so that files may be written; false while it is planned.
    again
        Names of codecs whose curves are coded and measured again in any case.
    """

    def __init__(
        self,
        flow: Workflow,
        provenance: Provenance | None,
        ancient: Callable[[Any], Any],
        local: Callable[[Any], Any],
        has_begun: bool,
        again: Collection[str] = (),
    ) -> None:
        self.flow, self.provenance = flow, provenance
        self.ancient, self.local = ancient, local
        self.again, self._has_begun = again, has_begun
        self._long: dict[Path, str] = {}

    def __call__(self, name: str, place: str) -> RuleStep:
        """Return what the rule `name` takes from its step.

        `place` is the path of the rule's log in the folder of logs, without the suffix.
        """
        return RuleStep(self, name, place)

    def settings(self, step: PlannedStep) -> str:
        """Return the settings of a step as one word of a command.

        Settings that are too long for a command are in a file, which is written when the run has
        begun.
        """
        if len(step.settings) <= _LONGEST:
            return shlex.quote(step.settings)
        path = self.flow.plan.results / ".settings" / f"{step.key}.json"
        if self._has_begun:
            write_bytes(path, step.settings.encode())
        else:
            self._long[path] = step.settings
        return shlex.quote(f"@{path}")

    def begin(self) -> None:
        """Write what planning has learned, and files with long settings, now and from now on."""
        self._has_begun = True
        self.flow.plan.memory.save()
        for path, settings in self._long.items():
            write_bytes(path, settings.encode())


class RuleStep:
    """What one rule takes from its step; the methods are functions of the rule's wildcards.

    Parameters
    ----------
    rules
        The rules of the run.
    name
        Name of the step.
    place
        Path of the rule's log in the folder of logs, without the suffix; with wildcards in braces.
        With the values of the wildcards, it is the name of the job.
    """

    def __init__(self, rules: Rules, name: str, place: str) -> None:
        self._rules, self._name, self._place = rules, name, place

    def step(self, wildcards: Any) -> PlannedStep:
        """Return the planned step; stop with one line if the plan has no such result."""
        return or_stop(self._rules.flow.step, self._name, **dict(wildcards.items()))

    @property
    def log(self) -> str:
        """Path of the log."""
        return f"{self._rules.flow.plan.results}/logs/{self._place}.log"

    def inputs(self, wildcards: Any) -> dict[str, Any]:
        """Return the files that the step reads, by input name."""
        step = self.step(wildcards)
        content = {name: self._rules.ancient(files) for name, files in step.content.items()}
        return {**step.inputs, **content, "planned": self._planned(wildcards, step)}

    def _planned(self, wildcards: Any, step: PlannedStep) -> Any:
        """Return the input that makes Snakemake run a job again, or leaves it alone.

        It is Snakemake's folder, whose time is that of the planning (`mark_planning`), so that it
        is newer than all results. The time counts only if the job's present results were made with
        other settings or code, or if its codec is one of `Rules.again`.
        """
        rules, job = self._rules, self._place.format(**wildcards)
        is_old = rules.provenance is not None and rules.provenance.is_made_otherwise(job, step.key)
        if is_old or getattr(wildcards, "codec", None) in rules.again:
            return rules.local(str(SNAKEMAKE_FOLDER))
        return rules.local(rules.ancient(str(SNAKEMAKE_FOLDER)))

    def settings(self, wildcards: Any) -> str:
        """Return the settings of the step as one word of a command."""
        return self._rules.settings(self.step(wildcards))

    def key(self, wildcards: Any) -> str:
        """Return the digest of the step's settings and code."""
        return self.step(wildcards).key

    def memory_mb(self, wildcards: Any, attempt: int) -> int:
        """Return the memory to request for an attempt, in MB."""
        return attempt * self.step(wildcards).memory_mb

    def minutes(self, wildcards: Any, attempt: int) -> int:
        """Return the time to request for an attempt, in minutes."""
        return attempt * self.step(wildcards).minutes

    def folder(self, wildcards: Any, input: Any) -> str:  # noqa: A002 (Snakemake's name)
        """Return the folder below which a step finds the files that its settings name.

        It is the results folder as the job sees it: if results are in remote storage, Snakemake
        gives the job local copies of its inputs.
        """
        names: Sequence[str] = getattr(self.step(wildcards).step, "names", ())
        results = str(self._rules.flow.plan.results)
        return shlex.quote(str(input.rows[0]).removesuffix(f"/{names[0]}") if names else results)
