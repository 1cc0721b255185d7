"""The jobs that rules and the command line run, each a record of settings with one method.

A job is what Snakemake runs as one process: its settings come from the plan as one record, its
files from the rule. ``python -m puckbench.jobs NAME RECORD.json key=FILE ...`` runs one.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Self

from puckbench.core.models import Model, parsed
from puckbench.core.registry import Registry


class Job(Model):
    """The settings of one unit of work, which `run` does from files to files."""

    @classmethod
    def given(cls, **settings: Any) -> Self:
        """The job of settings that a user gives; InputError names the one at fault."""
        return parsed(cls, settings, JOBS.name_of(cls))

    @abstractmethod
    def run(self, *args: Any, **files: Any) -> dict[str, Any]:
        """Read the inputs, write the outputs whole or not at all, and return what to print."""


JOBS: Registry[type[Job]] = Registry("job", "jobs")
