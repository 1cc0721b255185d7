"""The jobs that rules and the command line run, each a record of settings with one method.

A job is what Snakemake runs as one process: its settings come from the plan as one record, its
files from the rule. ``python -m puckbench.jobs NAME RECORD.json key=FILE ...`` runs one.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import Any, Self

from puckbench.core.models import Model, parsed
from puckbench.core.registry import Registry, trust


class Job(Model):
    """The settings of one unit of work, which `run` does from files to files."""

    @classmethod
    def given(cls, **settings: Any) -> Self:
        """The job of settings that a user gives; InputError names the one at fault."""
        return cls.of_record(settings, JOBS.name_of(cls))

    @classmethod
    def of_record(cls, record: Any, what: str) -> Self:
        """The job of settings that come from the command line, whose code is trusted.

        Parameters
        ----------
        record
            The settings by name.
        what
            Begins the line of an InputError.
        """
        job = parsed(cls, record, what)
        trust(job.plugins())
        return job

    def plugins(self) -> Iterable[str | None]:
        """What the settings name as plug-ins: names, or places of a user's own code."""
        return ()

    @abstractmethod
    def run(self, *args: Any, **files: Any) -> dict[str, Any]:
        """Read the inputs, write the outputs whole or not at all, and return what to print."""


JOBS: Registry[type[Job]] = Registry("job", "jobs")
